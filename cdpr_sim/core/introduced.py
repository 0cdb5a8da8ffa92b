"""How results introduce themselves: ``repr`` in a line, by each class itself, and in a notebook as HTML."""

from __future__ import annotations


class Introduced:
    """What a notebook shows as tables and pictures.

    The words for that live in ``report/``, above. This is the one place that reaches up, and only when it is asked.
    """

    def _repr_html_(self) -> str:
        from cdpr_sim.report.introductions import introduce

        return introduce(self)
