"""Numbers of a diagnosis in plain words.

With many samples every model is detectably wrong, so a verdict asks for two things: the deviation is outside what
chance does (the band of the test), and it is large enough to matter (the thresholds below).
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool

from sigmapoint.diagnosis.accuracy import Coverage
from sigmapoint.diagnosis.consistency import Consistency
from sigmapoint.diagnosis.verdict import Severity, Verdict
from sigmapoint.diagnosis.whiteness import Element

PARTICLES, SOME = 10, 0.05
"""Effective sample size below which moments mean little, and the share of rows for which nobody needs to act."""
FEW = 30
"""Samples below which nothing is said about whiteness and normality, nor of error bars that are too wide."""
TOLERATED = (0.8, 1.25)
"""Mean NIS or NEES per degree of freedom that nobody needs to act on."""
GROSS = 2.0
"""Mean NIS or NEES per degree of freedom above which error bars mislead."""
CORRELATED, STRONGLY = 0.1, 0.5
"""Correlations that matter, and that dominate."""
COVERED = 0.85
"""Coverage of ±2σ, nominally 0.95, that nobody needs to act on."""
HALF = 0.5
"""Coverage of ±1σ, nominally 0.68, below which errors are not spread as noise is."""
MOST = 5
"""States that are named."""
CHANCE = 0.001
"""p-value below which a deviation is not chance."""
NIS = ("NIS", "innovations", "measured element", "the measurements")
NEES = ("NEES", "errors", "state", "the states")


def of(
    nis: Consistency,
    elements: tuple[Element, ...],
    nees: Consistency | None,
    coverage: tuple[Coverage, ...],
    by_chance: tuple[float, ...],
    lost: int,
    wide: Mapping[str, float],
    few: float,
) -> tuple[Verdict, ...]:
    """Every verdict of a diagnosis, the question of consistency first."""
    whole = nis.rows > lost  # of a filter that broke down, what is left of the measurements says nothing
    said = [*_few(few), *_lost(lost), *_wide(wide), *(_samples(nis) if whole or not lost else [])]
    if nees is not None and nees.rows and whole:
        said += _contradiction(nis, nees)  # before the two that it reconciles
    if whole:
        said += [*_consistent(nis, *NIS), *_whiteness(elements)]
        said += [v for e in elements if e.samples >= FEW for v in (*_bias(e), *_tails(e), *_inputs(e))]
    if nees is not None and nees.rows:
        said += [*_consistent(nees, *NEES), *_coverage(coverage, by_chance)]
    return tuple(verdict for verdict in said if not (lost and verdict.severity == "good"))


def _few(few: float) -> list[Verdict]:
    if few <= SOME:
        return []
    return [
        Verdict(
            "bad" if few > HALF else "warning",
            f"In {few:.0%} of the rows the effective sample size (ess) is below {PARTICLES}: so few particles count "
            "there that the error bars mean little, and what follows is about the filter, not the model. Use a "
            "proposal that looks at the measurement, sp.proposals.guided(sp.srukf()), also in sp.auxiliary, or more "
            "particles.",
        )
    ]


def _lost(lost: int) -> list[Verdict]:
    if not lost:
        return []
    text = (
        f"The filter broke down: {lost} sample(s) have no finite estimate or innovation. Look for a model that returns "
        "NaN or infinity outside its range (sigma points go where no state is: guard sqrt, log and divisions), and for "
        "a first belief too far off."
    )
    return [Verdict("bad", text)]


def _wide(wide: Mapping[str, float]) -> list[Verdict]:
    """Sigma points of an angle past half a turn stand for others: the filter then takes the spread for smaller."""
    if not wide:
        return []
    listed = ", ".join(f"{name} (up to {std:.3g})" for name, std in wide.items())
    text = (
        f"The spread of {listed} exceeds what its space has room for, half a turn within two standard deviations: "
        "sigma points fold, and error bars can shrink although nothing is measured. Do not rely on the bars there and "
        "after; measure it more often, use a smaller process_noise, or hold the angle as its cosine and sine."
    )
    return [Verdict("warning", text)]


def _samples(nis: Consistency) -> list[Verdict]:
    if nis.rows >= FEW:
        return []
    if nis.rows == 0:
        return [Verdict("warning", "No usable measurement: the result is a prediction that nothing checks.")]
    return [Verdict("warning", f"Only {nis.rows} sample(s) were measured: too few to judge the filter by.")]


def _consistent(c: Consistency, short: str, what: str, per: str, about: str) -> list[Verdict]:
    low, high = c.band
    numbers = f"mean {short} {c.mean:.3g} per {per}, expected {low:.2f} to {high:.2f}"
    if low <= c.mean <= high or TOLERATED[0] <= c.mean <= TOLERATED[1]:
        outside = "" if low <= c.mean <= high else " (slightly outside, too little to matter)"
        share = f"{100 * c.inside:.0f} % of samples within their 95 % band"
        text = f"The error bars fit the {what}: {numbers}{outside}; {share}."
        return [Verdict("good", text)]
    if c.mean < low and c.rows < FEW:
        return []
    if c.mean < low:
        text = (
            f"The filter is underconfident about {about}: its {what} are on average {1 / max(c.mean, 1e-12):.3g} times "
            f"smaller (in variance) than it says ({numbers}). Try a smaller observation_noise or process_noise."
        )
        return [Verdict("warning", text)]
    text = (
        f"The filter is overconfident about {about}: its {what} are on average {c.mean:.3g} times larger (in variance) "
        f"than it says ({numbers}). "
    )
    if c.median < TOLERATED[1]:
        text += (
            f"A typical sample is within bounds ({100 * c.inside:.0f} % are inside their 95 % band): a few very "
            "large ones cause this: look for outliers, jumps, or a phase that the model does not describe."
        )
    else:
        text += "Try a larger observation_noise or process_noise, or add the missing state."
    return [Verdict("bad" if c.mean > GROSS else "warning", text)]


def _contradiction(nis: Consistency, nees: Consistency) -> list[Verdict]:
    """Noise levels cannot mend both: smaller ones for the innovations, larger ones for the errors."""
    small, large = min(TOLERATED[0], nis.band[0]), max(TOLERATED[1], nees.band[1])
    if nis.rows < FEW or not (nis.mean < small and nees.mean > large):
        return []
    text = (
        "Innovations that are too small beside errors that are too large are not a matter of noise levels: of the "
        "advice to lower and to raise them below, follow neither. The model is off in a way that the measurements "
        "hardly show. Look for a parameter or a table that is biased, and estimate it as a state."
    )
    return [Verdict("bad" if nees.mean > GROSS else "warning", text)]


def _whiteness(elements: tuple[Element, ...]) -> list[Verdict]:
    judged = [e for e in elements if e.samples >= FEW]
    coloured = [e for e in judged if e.ljung_box < CHANCE and _beyond(e).any()]
    if judged and not coloured:
        return [Verdict("good", "The innovations are uncorrelated in time: nothing slow is left unmodelled.")]
    return [_coloured(e) for e in coloured]


def _beyond(e: Element) -> Bool[np.ndarray, "L"]:
    """Lags whose autocorrelation is neither small nor chance."""
    return np.abs(e.autocorrelation) > np.maximum(CORRELATED, e.band)


def _coloured(e: Element) -> Verdict:
    lag = int(np.where(_beyond(e), np.abs(e.autocorrelation), 0.0).argmax())
    rho = e.autocorrelation[lag]
    severity: Severity = "bad" if abs(rho) > STRONGLY else "warning"
    numbers = f"{rho:+.2f} at lag {lag + 1}; chance stays within ±{e.band[lag]:.2f}"
    head = f"Innovations of {e.name} are correlated in time ({numbers}): "
    if rho > 0:
        advice = "something slow is not modelled. Add a state for it (a bias, a drift, a lag), or raise process_noise."
    else:
        advice = "the filter overreacts. Try a smaller process_noise or a larger observation_noise."
    return Verdict(severity, head + advice + " The band of the mean NIS is for white innovations, and too narrow here.")


def _bias(e: Element) -> list[Verdict]:
    if abs(e.bias) <= max(CORRELATED, 3.3 / e.samples**0.5):
        return []
    text = (
        f"Innovations of {e.name} are {e.bias:+.2f} standard deviations off zero on average: look for an offset of the "
        "sensor or of the model, and add it as a state."
    )
    return [Verdict("bad" if abs(e.bias) > 1 else "warning", text)]


def _tails(e: Element) -> list[Verdict]:
    if not (e.jarque_bera < CHANCE and (abs(e.skewness) > 0.5 or e.kurtosis > 1)):
        return []
    shape = "have heavier tails than a Gaussian" if e.kurtosis > 1 else "are lopsided"
    text = (
        f"Innovations of {e.name} {shape} (skewness {e.skewness:+.2g}, excess kurtosis {e.kurtosis:+.2g}): error bars "
        "understate rare large deviations. Look for outliers, or noise that is larger in some phases."
    )
    return [Verdict("warning", text)]


def _inputs(e: Element) -> list[Verdict]:
    related = [i for i in e.inputs if abs(i.correlation) > max(CORRELATED, 1.5 * i.band)]
    if not related:
        return []
    most = max(related, key=lambda i: abs(i.correlation))
    others = f" (also {', '.join(i.column for i in related if i is not most)})" if len(related) > 1 else ""
    text = (
        f"The effect of input {most.column}{others} on {e.name} is not fully modelled: innovations follow it "
        f"(correlation {most.correlation:+.2f}; chance stays within ±{most.band:.2f})."
    )
    return [Verdict("bad" if abs(most.correlation) > STRONGLY else "warning", text)]


def _coverage(states: tuple[Coverage, ...], by_chance: tuple[float, ...]) -> list[Verdict]:
    known = [c for c in states if c.samples]
    below = [(c, p) for c, p in zip(states, by_chance) if c.within[1] < COVERED]
    poor, open_ = [c for c, p in below if p < CHANCE], [c for c, p in below if not p < CHANCE]
    if known and not below:
        lowest = min(c.within[1] for c in known)
        text = f"Every ±2σ band covers the truth at least {100 * lowest:.1f} % of the time (95 % is nominal)."
        return [Verdict("good", text + _narrow(known))]
    said = []
    if poor:
        text = (
            f"The ±2σ band misses the truth too often (95 % is nominal): it covers {_share(poor)}. Do not rely on it."
        )
        said.append(Verdict("bad" if min(c.within[1] for c in poor) < 0.6 else "warning", text))
    if open_:
        text = (
            f"The ±2σ band covers {_share(open_)} (95 % is nominal), which may be chance: errors that last so long are "
            "worth few independent ones. More runs would tell, as of sp.simulate."
        )
        said.append(Verdict("warning", text))
    return said


def _share(states: list[Coverage]) -> str:
    worst = sorted(states, key=lambda c: c.within[1])[:MOST]
    more = f" and {len(states) - len(worst)} more" if len(states) > len(worst) else ""
    return ", ".join(f"{c.name} {100 * c.within[1]:.0f} %" for c in worst) + more


def _narrow(states: list[Coverage]) -> str:
    """What it means that ±1σ covers far less than ±2σ would make one think."""
    few = [c for c in states if c.within[0] < HALF]
    if not few:
        return ""
    listed = ", ".join(f"{c.name} {100 * c.within[0]:.0f} %" for c in few[:MOST])
    return (
        f" The ±1σ band covers much less than its 68 % ({listed}): the error stays between one and two standard "
        "deviations for long, as a bias does and noise does not. Rely on ±2σ, not on ±1σ."
    )
