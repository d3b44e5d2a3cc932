"""The report page and the plots of a result."""

try:
    import plotly  # noqa: F401
except ImportError as error:
    raise ImportError("reports need plotly and scipy: pip install sigmapoint[cli]") from error

from sigmapoint.reporting.page import report

__all__ = ["report"]
