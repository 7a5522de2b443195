"""One process at a time works in a folder, and nothing is left behind."""

import pytest

from lerobot_gcdt.locking import alone_in


def test_a_second_process_is_refused_with_the_folder_and_the_way_out(at_work, tmp_path):
    at_work(tmp_path / "parts")
    with pytest.raises(OSError, match="at work in .*parts.*--root"), alone_in(tmp_path / "parts"):
        pytest.fail("both processes are in")


def test_a_killed_process_leaves_no_lock(at_work, tmp_path):
    other = at_work(tmp_path / "parts")
    other.kill()
    other.join()
    with alone_in(tmp_path / "parts"):
        pass


def test_a_folder_that_holds_nothing_is_removed_in_the_end(tmp_path):
    with alone_in(tmp_path / "deep" / "parts"):
        assert (tmp_path / "deep" / "parts").is_dir()
    assert not (tmp_path / "deep" / "parts").exists()


def test_a_folder_with_files_is_kept_and_can_be_entered_again(tmp_path):
    for name in ("first", "second"):
        with alone_in(tmp_path / "parts"):
            (tmp_path / "parts" / name).touch()
    assert {"first", "second"} <= {path.name for path in (tmp_path / "parts").iterdir()}


def test_an_error_ends_the_stay(tmp_path):
    with pytest.raises(KeyError), alone_in(tmp_path / "parts"):
        raise KeyError
    with alone_in(tmp_path / "parts"):
        pass


def test_a_folder_that_the_block_removes_is_no_trouble(tmp_path):
    with alone_in(tmp_path / "parts"):
        (tmp_path / "parts" / "lock").unlink()
        (tmp_path / "parts").rmdir()
    assert not list(tmp_path.iterdir())
