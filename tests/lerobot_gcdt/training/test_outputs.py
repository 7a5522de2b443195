"""What a training leaves in its folder."""

from lerobot_gcdt.training import loss_curve


def test_steps_that_were_repeated_count_once_in_the_loss_curve(tmp_path):
    (tmp_path / "loss.csv").write_text("step,loss\n1,0.5\n2,0.4\n3,0.35\n2,0.4\n3,0.3\n4,0.2\n")
    curve = loss_curve(tmp_path)
    assert curve.step.tolist() == [1, 2, 3, 4] and curve.loss.tolist() == [0.5, 0.4, 0.3, 0.2]
