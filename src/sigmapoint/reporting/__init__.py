"""The report page."""

from sigmapoint import checks

checks.extra("plotly", "report")

from sigmapoint.reporting.page import report  # noqa: E402 (what is missing is said first)

__all__ = ["report"]
