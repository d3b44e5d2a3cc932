"""The options experiment: a quick run on simulated markets, and Table 7.2 where the real data are at hand."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.options import runs as options_runs
from sigmapoint.experiments.options import table as options_table
from sigmapoint.experiments.options.table import AHEAD, DRAWN, EXACT, KINDS, SEEN, SHOWN, TABLE, TRIVIAL

FTSE100 = os.environ.get("SIGMAPOINT_FTSE100", "")
FIGURES = ("options-forecasts", "options-states", "options-smile")
WIDE = f"{SHOWN}, {options_table.PROPOSING}"


def measured_of(rows):
    return {(row["quantity"], row["method"]): row["measured"] for row in rows}


def norm(kind, strike, when):
    """The quantity of an error in the table."""
    return f"{kind}, strike {strike}: {when}, norm over days 104 to 204"


def test_errors_are_norms_over_the_last_days_and_trivial_is_the_day_before():
    prices = np.zeros((1, 204, 2))
    prices[0, 102:] = [3.0, 4.0]  # a step from day 102 to day 103, before those that are judged
    prices[0, 150, 1] += 1
    np.testing.assert_allclose(options_runs.errors(prices, options_runs.trivial(prices)), [[0, 2**0.5]])
    np.testing.assert_allclose(options_runs.errors(prices, prices + 0.1), [[0.1 * 101**0.5] * 2])


def test_a_quick_run_finds_the_volatility_of_simulated_markets_and_is_written(tmp_path):
    rows = EXPERIMENTS["options"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert all((tmp_path / f"{figure}.png").exists() for figure in FIGURES)
    assert all(row["published"] is None for row in rows)
    measured = measured_of(rows)
    for strike in (2925, 3025, 3125, 3225, 3325):
        for kind in KINDS:
            ahead = norm(kind, strike, AHEAD)
            assert measured[ahead, SHOWN] < measured[ahead, TRIVIAL]
            assert measured[ahead, WIDE] > measured[ahead, SHOWN]
            assert measured[norm(kind, strike, SEEN), WIDE] < 0.6 * measured[norm(kind, strike, SEEN), SHOWN]
            if strike == TABLE:
                # (Proposals of the EKF lose one market of these four.)
                drawn, seen, one_step = (
                    measured[norm(kind, strike, when), f"UPF, {EXACT}"] for when in (DRAWN, SEEN, AHEAD)
                )
                assert drawn < seen < one_step
                assert measured[norm(kind, strike, DRAWN), "PF"] == pytest.approx(measured[ahead, "PF"], rel=1e-6)
        # of a volatility that wanders by about 0.04
        assert measured[f"error of the volatility, rms, 1/√year: {SHOWN}", f"strike {strike}"] < 0.03


@pytest.mark.parametrize("folder", [{}, {"c2925.prn": "1 2 3"}])
def test_a_folder_without_the_data_is_refused(tmp_path, folder):
    for name, content in folder.items():
        (tmp_path / name).write_text(content)
    with pytest.raises(FileNotFoundError, match=r"prn: no such file; the folder must hold"):
        EXPERIMENTS["options"].run(None, 0, tmp_path / "out", True, tmp_path)


@pytest.mark.skipif(not FTSE100, reason="SIGMAPOINT_FTSE100 does not name a folder with the real prices")
def test_the_real_market_gives_the_published_table(tmp_path):
    rows = EXPERIMENTS["options"].run(10, 0, tmp_path, False, Path(FTSE100))
    measured = measured_of(rows)
    for kind in KINDS:
        for name in (TRIVIAL, "EKF", "UKF"):
            value = measured[norm(kind, options_table.TABLE, AHEAD), name]
            assert value == pytest.approx(options_table.FOUR_DIGITS[kind][name], abs=6e-5)
            assert value == pytest.approx(options_table.PUBLISHED[AHEAD, kind][name], rel=0.1, abs=0.001)
        for when, name in ((AHEAD, "PF"), (DRAWN, "PF-EKF"), (DRAWN, "UPF")):
            value = measured[norm(kind, TABLE, when), name]
            for given in (options_table.FOUR_DIGITS[kind][name], options_table.PUBLISHED[when, kind][name]):
                assert value == pytest.approx(given, rel=0.1, abs=0.001)
        for name in (f"PF-EKF, {EXACT}", f"UPF, {EXACT}"):
            assert measured[norm(kind, TABLE, AHEAD), name] > 1.1 * measured[norm(kind, TABLE, AHEAD), f"PF, {EXACT}"]
    assert {row["published"] for row in rows} == {None, 0.078, 0.037, 0.035, 0.023, 0.009, 0.008, 0.007}
    smile = [measured[f"volatility on the last day, 1/√year: {SHOWN}", f"strike {k}"] for k in (2925, 3125, 3325)]
    assert smile == sorted(smile, reverse=True)
