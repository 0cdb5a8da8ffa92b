"""Where does the platform of a cable-driven parallel robot really end up? Statics and MuJoCo, cross-checked.

The names below are the public API. They load on first use, so that importing the package stays light: what they are
and where they live is in ``__init__.pyi``.
"""

import lazy_loader

from cdpr_sim.core.html_repr import HtmlRepr as _Introduced

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, or the version that is installed."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("cdpr-sim")
        except PackageNotFoundError:  # run from its sources
            return "unknown"
    return _attribute(name)


def _in_html(result: object) -> str:
    """What a notebook shows of a result; tables are loaded when the first is shown."""
    from cdpr_sim.report.notebook import html_of

    return html_of(result)


_Introduced._in_html = staticmethod(_in_html)
