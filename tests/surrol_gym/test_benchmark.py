import pytest

from surrol_gym import benchmark


def test_every_number_is_measured():
    row = benchmark.measure("NeedleReach", episodes=1)
    assert row.keys() == benchmark.COLUMNS.keys()
    assert all(value > 0 for name, value in row.items() if name != "MB")
    assert row["x bare"] > 1, "a control step holds its 48 sub-steps"
    assert row["x orig."] == pytest.approx(row["steps/s"] / 57)


def test_the_table_has_a_row_for_each_asked_task(capsys):
    benchmark.main(["--tasks", "NeedleReach,GauzeRetrieve", "--episodes", "1"])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if line.startswith(("NeedleReach ", "GauzeRetrieve "))] == [
        "NeedleReach",
        "GauzeRetrieve",
    ]


@pytest.mark.parametrize(("arguments", "named"), [(["--tasks", "Sewing"], "Sewing"), (["--episodes", "0"], "got 0")])
def test_bad_arguments_are_named(capsys, arguments, named):
    with pytest.raises(SystemExit):
        benchmark.main(arguments)
    assert named in capsys.readouterr().err
