"""The picture of what the paper's tasks ask of a dVRK."""

from PIL import Image


def test_it_draws_a_panel_for_every_task(tmp_path, run_example):
    two, one = tmp_path / "pictures" / "two.png", tmp_path / "one.png"
    printed = run_example("dvrk_trajectories", "--tasks=NeedleReach,BiPegTransfer", f"--output={two}")
    assert str(two) in printed
    run_example("dvrk_trajectories", "--tasks=NeedleReach", f"--output={one}")
    assert Image.open(two).width == 2 * Image.open(one).width
