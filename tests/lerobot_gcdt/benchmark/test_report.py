"""The tables and the figures say what the episodes say."""

import itertools

import pandas as pd
import pytest
from matplotlib.container import BarContainer

from lerobot_gcdt.benchmark.report import (
    in_order,
    plot_bars,
    plot_demonstrations,
    plot_noise,
    plot_success,
    success_latex,
    success_rates,
    success_table,
    write_report,
)
from lerobot_gcdt.evaluation.statistics import trainings_interval, wilson_interval
from surrol_gym.wrappers import IDEAL

SUCCESSES = {("bc", 0): (4, 10), ("bc", 1): (6, 16), ("gcdt", 0): (5, 15)}
"""Of 20 episodes of each training, half way and at its end; one fewer is held."""


def episodes(demonstrations: int) -> pd.DataFrame:
    rows = []
    for ((method, training), successes), task in itertools.product(SUCCESSES.items(), ["NeedlePick", "PegTransfer"]):
        for step, of_20 in zip((50, 100), successes, strict=True):
            facts = {"method": method, "task": task, "demonstrations": demonstrations, "training_seed": training}
            facts |= {"step": step, "seconds": step * (2 if training else 1)}
            rows += [
                facts | {"seed": seed, "reached": seed < of_20, "held": seed < of_20 - 1, "steps": 9.0}
                for seed in range(20)
            ]
    return pd.DataFrame(rows)


def of_sensors(*levels: float) -> pd.DataFrame:
    return pd.concat([episodes(100).assign(**IDEAL | {"position_std": level}) for level in levels])


@pytest.fixture(scope="module")
def rates():
    return success_rates(episodes(100))


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are saved."""
    figures = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: figures.append(figure))
    return figures


def point(rates, method, step):
    [(_, row)] = rates[(rates.task == "NeedlePick") & (rates.method == method) & (rates.step == step)].iterrows()
    return row


def test_there_is_a_point_for_each_task_method_and_step(rates):
    points = itertools.product(["NeedlePick", "PegTransfer"], ["bc", "gcdt"], [50, 100])
    assert sorted(rates[["task", "method", "step"]].itertuples(index=False, name=None)) == sorted(points)


def test_a_point_is_the_mean_of_the_trainings(rates):
    row = point(rates, "bc", 100)
    assert (row.trainings, row.starts, row.seconds) == (2, 20, 150)
    assert (row.reached, row.held) == pytest.approx((13 / 20, 12 / 20))
    assert (row.reached_low, row.reached_high) == trainings_interval([10 / 20, 16 / 20], 20)


def test_a_single_training_has_wilsons_interval(rates):
    row = point(rates, "gcdt", 50)
    assert (row.reached_low, row.reached_high) == pytest.approx(wilson_interval(5, 20))
    assert (row.held_low, row.held_high) == pytest.approx(wilson_interval(4, 20))


def test_the_table_tells_the_end_of_the_trainings(rates):
    header, _, *lines = success_table(rates).splitlines()
    assert header == "| task | method | demonstrations | trainings | starts | steps | seconds | reached | held |"
    low, high = wilson_interval(14, 20)
    assert f"| NeedlePick | gcdt | 100 | 1 | 20 | 100 | 100 | 0.75 (0.53-0.89) | 0.70 ({low:.2f}-{high:.2f}) |" in lines
    assert len(lines) == 4


def test_the_latex_table_has_a_row_for_each_task_and_a_column_for_each_method(rates):
    rows = [
        [cell.strip(" \\") for cell in line.split("&")] for line in success_latex(rates).splitlines() if "&" in line
    ]
    assert rows == [
        ["reached / held", "bc", "gcdt"],
        ["NeedlePick", "0.65 / 0.60", "0.75 / 0.70"],
        ["PegTransfer", "0.65 / 0.60", "0.75 / 0.70"],
    ]


def test_the_bars_are_the_rates_at_the_end_of_the_trainings(rates, tmp_path, drawn):
    plot_bars(rates, tmp_path / "bars.png")
    [axes] = drawn[0].axes
    bars = {
        container.get_label(): container for container in axes.containers if container.get_label() in ("bc", "gcdt")
    }
    assert [bar.get_height() for bar in bars["bc"]] == pytest.approx([12 / 20] * 2)
    assert [bar.get_height() for bar in bars["gcdt"]] == pytest.approx([14 / 20] * 2)
    assert [line.get_ydata().tolist() for line in axes.lines if line.get_marker() == "o"] == [
        pytest.approx([13 / 20] * 2),
        pytest.approx([15 / 20] * 2),
    ]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["NeedlePick", "PegTransfer"]


def test_the_figure_has_a_panel_for_each_task(rates, tmp_path, drawn):
    plot_success(rates, tmp_path / "success.png")
    [figure] = drawn
    assert [axes.get_title() for axes in figure.axes] == ["NeedlePick", "PegTransfer"]
    for axes in figure.axes:
        assert axes.get_xscale() == "log"
        lines = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
        assert lines["_bc reached"] == [[75, pytest.approx(0.25)], [150, pytest.approx(0.65)]]
        assert set(lines) == {"bc", "_bc reached", "gcdt", "_gcdt reached"}
        assert len(axes.collections) == len(lines), "every line has the band of its intervals"


@pytest.mark.parametrize("plot", [plot_demonstrations, plot_success])
def test_an_expert_who_learned_nothing_is_a_level_line(tmp_path, drawn, plot):
    expert = episodes(0).query("method == 'gcdt' and step == 100").assign(method="expert", seconds=0.0)
    plot(success_rates(pd.concat([episodes(100), expert])), tmp_path / "drawn.png")
    lines = {line.get_label(): line for line in drawn[0].axes[0].lines}
    assert list(lines["expert"].get_ydata()) == pytest.approx([14 / 20] * 2)
    assert list(lines["expert"].get_xdata()) == [0, 1], "of the width of the panel"


@pytest.mark.parametrize("plot", [plot_bars, plot_success])
def test_all_methods_stand_in_the_legend_inside_the_figure_in_a_colour_each(tmp_path, drawn, plot):
    names = [*("gcdt", "bc", "dt", "dt-goal", "vinn", "iql", "plas", "act", "diffusion", "fine-tuned", "generalist")]
    one = episodes(100).query("method == 'gcdt' and task == 'NeedlePick'")
    plot(success_rates(pd.concat([one.assign(method=name) for name in names])), tmp_path / "drawn.png")
    [figure] = drawn
    figure.draw_without_rendering()
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == names
    left, right = legend.get_window_extent().intervalx
    assert left >= 0 and right <= figure.bbox.width
    colours = [handle.get_facecolor() if plot is plot_bars else handle.get_color() for handle in legend.legend_handles]
    assert len(set(colours)) == len(names)


def test_bars_of_many_tasks_and_methods_stand_in_rows(tmp_path, drawn):
    tasks, names = [f"Task{i}" for i in range(10)], [f"method{i}" for i in range(9)]
    one = episodes(100).query("method == 'gcdt' and task == 'NeedlePick'")
    many = [one.assign(task=task, method=name) for task, name in itertools.product(tasks, names)]
    plot_bars(success_rates(pd.concat(many)), tmp_path / "bars.png")
    [figure] = drawn
    assert figure.get_figwidth() <= 16
    assert [text.get_text() for axes in figure.axes for text in axes.get_xticklabels()] == tasks


def test_a_method_that_some_rows_lack_has_the_colour_of_its_bars_in_the_legend(tmp_path, drawn):
    tasks, names = [f"Task{i}" for i in range(10)], [f"method{i}" for i in range(9)]
    one = episodes(100).query("method == 'gcdt' and task == 'NeedlePick'")
    many = [one.assign(task=task, method=name) for task, name in itertools.product(tasks, names)]
    alone = [one.assign(task=task, method=f"only in {task}") for task in (tasks[0], tasks[-1])]
    plot_bars(success_rates(pd.concat([*many, *alone])), tmp_path / "bars.png")
    [figure] = drawn
    [legend] = figure.legends
    shown = dict(zip([text.get_text() for text in legend.get_texts()], legend.legend_handles, strict=True))
    bars = {bar.get_label(): bar[0] for axes in figure.axes for bar in axes.containers if isinstance(bar, BarContainer)}
    assert set(shown) == set(bars) == {*names, "only in Task0", "only in Task9"}
    for name, bar in bars.items():
        assert shown[name].get_facecolor() == bar.get_facecolor()


def test_success_is_drawn_against_the_number_of_demonstrations(tmp_path, drawn):
    rates = success_rates(pd.concat([episodes(25), episodes(100)]))
    plot_demonstrations(rates, tmp_path / "demonstrations.png")
    [figure] = drawn
    lines = {line.get_label(): line.get_xydata().tolist() for line in figure.axes[0].lines}
    assert lines["gcdt"] == [[25, pytest.approx(14 / 20)], [100, pytest.approx(14 / 20)]]


def test_success_is_drawn_against_noise(tmp_path, drawn):
    plot_noise(success_rates(of_sensors(0.01, 0.02)), tmp_path / "noise.png")
    [figure] = drawn
    lines = {line.get_label(): line.get_xydata().tolist() for line in figure.axes[0].lines}
    assert lines["gcdt"] == [[0.01, pytest.approx(14 / 20)], [0.02, pytest.approx(14 / 20)]]


def test_numbers_of_demonstrations_are_compared_in_a_figure_and_a_table_of_their_own(tmp_path):
    write_report(pd.concat([episodes(25), episodes(100)]), tmp_path)
    assert (tmp_path / "demonstrations.png").read_bytes().startswith(b"\x89PNG")
    assert "| NeedlePick | gcdt | 25 | 1 |" in (tmp_path / "success.md").read_text()
    assert (tmp_path / "success.tex").read_text() == success_latex(success_rates(episodes(100)))


def test_there_is_no_figure_of_one_number_of_demonstrations(tmp_path):
    write_report(episodes(100), tmp_path)
    assert not (tmp_path / "demonstrations.png").exists()


def test_settings_of_imperfect_sensors_are_told_apart_in_the_table():
    rates = success_rates(of_sensors(0.01, 0.02))
    header, _, *lines = success_table(rates).splitlines()
    assert header.startswith("| task | method | position_std | demonstrations |")
    assert len(lines) == 8 and any(line.startswith("| NeedlePick | gcdt | 0.02 | 100 |") for line in lines)


def test_episodes_are_sorted_by_task_in_the_usual_order_and_by_method():
    rows = pd.DataFrame({"task": ["PegTransfer", "NeedlePick", "PegTransfer"], "method": ["a", "a", "b"]})
    assert in_order(rows, ["b", "a"]).values.tolist() == [
        ["NeedlePick", "a"],
        ["PegTransfer", "b"],
        ["PegTransfer", "a"],
    ]
