"""How the command line reads its words, beyond what typer does by itself."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

from cdpr_sim.cli.terminal import outside_world


class CommandGroup(TyperGroup):
    """All commands; whatever they print arrives, or the exit status says that it did not."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """The words as a context: where ``--help`` is printed."""
        with outside_world():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        with outside_world():
            return super().invoke(ctx)


class CommandWithHelp(TyperCommand):
    """A command whose coordinates may be given with commas as well, ``--pose 0.1,0.2,0.3``, with a blank or with =."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """With what commas hold together taken apart."""
        counts = {name: option.nargs for option in self.params for name in option.opts if option.nargs > 1}
        spread = []
        for before, word in zip([None, *args], args, strict=False):
            option, equals, value = word.partition("=")
            name, value = (option, value) if equals and option in counts else (before, word)
            parts = [part.strip() for part in value.split(",")]
            apart = len(parts) > 1 and len(parts) == counts.get(name or "")
            spread += [*([option] if value != word else []), *parts] if apart else [word]
        return super().parse_args(ctx, spread)

    def get_short_help_str(self, limit: int = 45) -> str:
        """The first sentence, whole: lines are broken, not cut."""
        del limit
        first = (self.help or "").strip().partition("\n\n")[0].partition(". ")[0]
        return self.short_help or f"{' '.join(first.split()).rstrip('.')}."
