"""Table 7.2 of Wan & van der Merwe (2001) beside what is measured, and what of it holds (experiment: `options`)."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from sigmapoint.experiments.options.runs import JUDGED, Found, Markets, errors, trivial
from sigmapoint.experiments.publishing.results import Claim, Mean, Row, ahead, mean_of, plus_minus, positive

TRIVIAL, SHOWN = "trivial", "UKF"
TABLE = 2925
"""the strike of Table 7.2"""
PROPOSING = "noise of the proposals"
EXACT = "exact densities"
KINDS = ("call", "put")
AHEAD, SEEN, DRAWN = "one-step errors", "errors having seen the day", "errors of the draws, having seen the day"
"""the last of the mean price of particles as drawn, before they are weighted"""
PUBLISHED = {
    (AHEAD, "call"): {TRIVIAL: 0.078, "EKF": 0.037, "UKF": 0.037, "PF": 0.037},
    (AHEAD, "put"): {TRIVIAL: 0.035, "EKF": 0.023, "UKF": 0.023, "PF": 0.023},
    (DRAWN, "call"): {"PF-EKF": 0.009, "UPF": 0.009},
    (DRAWN, "put"): {"PF-EKF": 0.007, "UPF": 0.008},
}
"""Table 7.2, which prints all of them as one-step errors."""
FOUR_DIGITS = {
    "call": {TRIVIAL: 0.0788, "EKF": 0.0372, "UKF": 0.0372, "PF": 0.0373, "PF-EKF": 0.0094, "UPF": 0.0086},
    "put": {TRIVIAL: 0.0344, "EKF": 0.0224, "UKF": 0.0224, "PF": 0.0225, "PF-EKF": 0.0068, "UPF": 0.0080},
}
"""The same of another implementation of this protocol, to four digits."""

Results = Mapping[int, Mapping[str, Found]]
"""by strike and method"""
Scores = Mapping[str, Mapping[str, Float[np.ndarray, "R 2"]]]


def scores(markets: Markets, found: Results, strike: int) -> dict[str, dict[str, Float[np.ndarray, "R 2"]]]:
    """Of call and put by method: one-step errors, those having seen the day, those of particles as drawn."""
    prices = np.asarray(markets.prices(strike))
    before = {name: errors(prices, one.ahead) for name, one in found[strike].items()}
    seen = {name: errors(prices, one.seen) for name, one in found[strike].items()}
    drawn = {name: errors(prices, one.drawn) for name, one in found[strike].items() if one.drawn is not None}
    return {AHEAD: {TRIVIAL: errors(prices, trivial(prices)), **before}, SEEN: seen, DRAWN: drawn}


def rows(markets: Markets, found: Results, notes: Mapping[str, str]) -> list[Row]:
    """The numbers; those of the strike of Table 7.2 first."""
    ordered = sorted(markets.strikes, key=lambda strike: strike != TABLE)
    return [
        *(row for strike in ordered for i in range(len(KINDS)) for when in (AHEAD, SEEN, DRAWN)
          for row in _of_prices(markets, found, notes, strike, i, when)),
        *_by_strike(found, "NIS per price, 1 where the noise is right", lambda _, one: one.nis[:, JUDGED].mean(1) / 2),
        *_by_strike(found, "volatility on the last day, 1/√year", lambda _, one: one.mean[:, -1, 1]),
        *_by_strike(found, "its standard deviation by the filter itself", lambda _, one: one.std[:, -1, 1]),
        *([] if markets.real else (
            *_by_strike(found, "error of the volatility, rms, 1/√year",
                        lambda strike, one: np.sqrt((_off(markets, strike, one) ** 2).mean(1))),
            *_by_strike(found, "share of days with the volatility within 2σ, 0.954 if Gaussian",
                        partial(_inside, markets)),
        )),
    ]  # fmt: skip


def _of_prices(markets: Markets, found: Results, notes: Mapping[str, str], strike: int, i: int, when: str) -> list[Row]:
    """Errors of the prices of calls or puts."""
    kind = KINDS[i]
    published = PUBLISHED.get((when, kind), {}) if markets.real and strike == TABLE else {}
    other = {name: FOUR_DIGITS[kind][name] for name in published}
    quantity = f"{kind}, strike {strike}: {when}, norm over days 104 to 204"
    return [
        _row(quantity, name, score[:, i], _note(notes[name], other.get(name)), published.get(name))
        for name, score in scores(markets, found, strike)[when].items()
    ]


def _note(settings: str, other: float | None) -> str:
    return "; ".join(filter(None, (settings, "" if other is None else f"another implementation: {other:.4f}")))


def _by_strike(found: Results, quantity: str, of: Callable[[int, Found], np.ndarray]) -> list[Row]:
    """Of one method, a row for each strike."""
    return [_row(f"{quantity}: {SHOWN}", f"strike {strike}", of(strike, each[SHOWN])) for strike, each in found.items()]


def _off(markets: Markets, strike: int, one: Found) -> Float[np.ndarray, "R D"]:
    """Error of the volatility on the days that are judged."""
    return (one.mean[:, :, 1] - markets.volatility(strike))[:, JUDGED]


def _inside(markets: Markets, strike: int, one: Found) -> Float[np.ndarray, " R"]:
    """Share of those days with the volatility within two standard deviations."""
    return (np.abs(_off(markets, strike, one)) < 2 * one.std[:, JUDGED, 1]).mean(1)


def _row(quantity: str, method: str, samples: np.ndarray, note: str = "", published: float | None = None) -> Row:
    mean = mean_of(samples) if samples.size > 1 else Mean(float(samples[0]), np.nan, 1)
    return Row("options", quantity, method, published, mean.value, mean.spread, mean.runs, note)


def claim(markets: Markets, found: Results) -> Claim:
    """Table 7.2, for real prices; for simulated ones its order."""
    score = scores(markets, found, TABLE)
    if not markets.real:
        gains = {kind: ahead(score[AHEAD][TRIVIAL][:, i], score[AHEAD][SHOWN][:, i]) for i, kind in enumerate(KINDS)}
        return Claim(
            "(in simulated markets) the filter's prices are nearer than those of the day before",
            {f"{kind}: by {plus_minus(gain)}": positive(gain) for kind, gain in gains.items()},
        )
    return Claim(
        "Table 7.2",
        {
            f"{kind}, {name} {measured:.4f} (published {value:.3f})": close
            for i, kind in enumerate(KINDS)
            for name, (measured, value, close) in cells(score, i).items()
        },
    )


def cells(score: Scores, i: int) -> dict[str, tuple[float, float, bool]]:
    """Of one kind: measured, published, and whether they are within 10 % or 0.001 of each other."""
    each = {
        name: (float(score[when][name][:, i].mean()), value)
        for when in (AHEAD, DRAWN)
        for name, value in PUBLISHED[when, KINDS[i]].items()
    }
    return {
        name: (found, value, abs(found - value) <= max(0.001, 0.1 * value)) for name, (found, value) in each.items()
    }


def findings(markets: Markets, found: Results) -> Sequence[str]:
    """What came out, in words."""
    score = scores(markets, found, TABLE)
    said = (*printed(score), fitted(score)) if markets.real else (
        *over_markets(score), honest(markets, found), fitted(score))  # fmt: skip
    return *said, drawing(score)


def printed(score: Scores) -> Sequence[str]:
    """What became of Table 7.2."""
    said = []
    for i, kind in enumerate(KINDS):
        each = cells(score, i)
        far = [name for name, (_, _, close) in each.items() if not close]
        numbers = ", ".join(f"{name} {measured:.4f} ({value:.3f})" for name, (measured, value, _) in each.items())
        said.append(
            f"Table 7.2, {kind}, strike {TABLE}, errors measured (published), those of PF-EKF and UPF of the draws: "
            f"{numbers}. Within 10 % or 0.001: {'reproduced' if not far else 'all but ' + ', '.join(far)}."
        )
    return said


def over_markets(score: Scores) -> Sequence[str]:
    """What holds over many simulated markets."""
    said = [
        "Simulated markets. Table 7.2 is of a real one, whose data cannot be passed on; it is shown beside what is "
        "measured where --data names a folder with them."
    ]
    for i, kind in enumerate(KINDS):
        of_method = {name: each[:, i] for name, each in score[AHEAD].items()}
        for worse, better in ((TRIVIAL, "EKF"), ("EKF", "UKF")):
            less = ahead(of_method[worse], of_method[better])
            said.append(
                f"{kind.capitalize()}, strike {TABLE}, one-step errors: {worse} minus {better}, on the same markets, "
                f"{less.value:.1e} ± {less.spread:.0e}, or {less.value / of_method[worse].mean():.2%} of {worse}."
            )
    return said


def honest(markets: Markets, found: Results) -> str:
    """How far the standard deviations of the volatility can be trusted, in simulated markets."""
    shares = [_inside(markets, strike, each[SHOWN]).mean() for strike, each in found.items()]
    return (
        f"The volatility is within 2σ of the {SHOWN} on {min(shares):.0%} to {max(shares):.0%} of the days, by strike. "
        "Two things that the filter does not know keep it from 95 %: prices are cut off at zero, and the index moves "
        "along the smile. In markets with neither it is 94 % (60 markets)."
    )


def fitted(score: Scores) -> str:
    """What the noise of the proposals does to both kinds of error."""

    def of(name: str, when: str, i: int) -> str:
        return f"{score[when][name][:, i].mean():.4f}"

    wide = f"{SHOWN}, {PROPOSING}"
    said = "; ".join(
        f"{kind} {of(wide, AHEAD, i)} one step ahead (with that of Table 7.2 {of(SHOWN, AHEAD, i)}), "
        f"{of(wide, SEEN, i)} having seen the day (with that of Table 7.2 {of(SHOWN, SEEN, i)})"
        for i, kind in enumerate(KINDS)
    )
    return (
        f"Strike {TABLE}, the {SHOWN} with the noise of the published proposals, without any particle: {said}. That "
        "noise follows the prices of the day more closely, and predicts the next ones less well."
    )


def drawing(score: Scores) -> str:
    """What particle filters with proposals do, and which of their errors are printed."""

    def of(name: str, i: int) -> str:
        ahead, seen, drawn = (score[when][name][:, i].mean() for when in (AHEAD, SEEN, DRAWN))
        return (
            f"{name}, {KINDS[i]}: {ahead:.4f} one step ahead, {seen:.4f} having seen the day, {drawn:.4f} of the draws"
        )

    names = (f"{name}, {EXACT}" for name in PUBLISHED[DRAWN, "call"])
    said = "; ".join(of(name, i) for name in names for i in range(len(KINDS)))
    return (
        f"Strike {TABLE}, particle filters with proposals. {said}. What Table 7.2 prints for them is the last: "
        "the mean price of the particles as drawn, knowing the prices of the day, before they are weighted. No "
        f"forecast: one step ahead they are behind the PF ({score[AHEAD][f'PF, {EXACT}'][:, 0].mean():.4f}, "
        f"{score[AHEAD][f'PF, {EXACT}'][:, 1].mean():.4f}). The printed ones come of a program that adds 1e-99 to "
        "every density, so that a price decides over its proposal alone, and has a slip in the slope of the EKF."
    )
