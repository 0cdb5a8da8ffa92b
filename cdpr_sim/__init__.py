"""Static equilibria of cable-driven parallel robots with elastic cables, by statics and by MuJoCo, cross-checked.

The names below are the public API. They load on first use, so that importing the package is fast: ``__init__.pyi``
lists them and their modules.
"""

import lazy_loader

from cdpr_sim.core.html_repr import HtmlRepr as _Introduced
from cdpr_sim.core.sweep_quantities import BySimulation as _BySimulation
from cdpr_sim.core.with_mass import WithMass as _WithMass

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, or the installed version."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("cdpr-sim")
        except PackageNotFoundError:  # run from its sources
            return "unknown"
    return _attribute(name)


def _in_html(result: _Introduced) -> str:
    """Display of a result in a notebook; the tables are imported at the first call."""
    from cdpr_sim.report.notebook import html_of

    return html_of(result)


_Introduced._in_html = staticmethod(_in_html)


def _cut(*arguments: object, **options: object) -> tuple:
    """Rest lengths and wrench matrix under given tensions; statics is imported at the first call."""
    from cdpr_sim.statics.given_tensions import cut

    return cut(*arguments, **options)  # type: ignore[arg-type]


_WithMass.cut = staticmethod(_cut)


def _settled() -> object:
    """The quantities of a sweep by simulation; MuJoCo is imported at the first call."""
    from cdpr_sim.crosscheck import settled_quantities

    return settled_quantities


_BySimulation.settled = staticmethod(_settled)  # type: ignore[assignment]
