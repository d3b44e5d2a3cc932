"""The Mackey-Glass series through noise."""

import json

from sigmapoint.experiments import EXPERIMENTS


def test_a_quick_run_shows_the_ordering_and_the_time(tmp_path):
    rows = EXPERIMENTS["mackey-glass"].run(None, 0, tmp_path, True)
    assert rows == json.loads((tmp_path / "results.json").read_text())
    assert (tmp_path / "mackey-glass.png").exists()
    found = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    assert found["normalised MSE", "UKF"] < found["normalised MSE", "EKF"] < 0.5
    assert found["largest difference from the dense form", "SR-UKF"] < 1e-6
    times = {other: found["time of a step [µs]", other] for other in ("SR-UKF", "UKF", "EKF")}
    for other in ("UKF", "EKF"):  # medians of two repetitions: of ratios, and ratios of them
        ratio = found["time of a step of the SR-UKF over that of this", other]
        assert 0.2 < ratio * times[other] / times["SR-UKF"] < 5
