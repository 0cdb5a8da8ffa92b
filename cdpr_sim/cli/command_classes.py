"""Parsing of the command line beyond what typer does."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

from cdpr_sim.cli.terminal import errors_as_sentences, outside_world


class CommandGroup(TyperGroup):
    """Group of all commands; a failure to write the output is reported by the exit status."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Parse the arguments; ``--help`` is printed here."""
        with outside_world():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with outside_world():
            return super().invoke(ctx)


class CommandWithHelp(TyperCommand):
    """Command that also accepts coordinates separated by commas: ``--pose 0.1,0.2,0.3`` or ``--pose=0.1,0.2,0.3``.

    An option of one text whose metavar names several numbers takes any number of them, separated by spaces or commas.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Split comma-separated values of options that take several numbers; join those of any number of them."""
        counts = {name: option.nargs for option in self.params for name in option.opts if option.nargs > 1}
        lists = {name for one in self.params if one.nargs == 1 and " " in (one.metavar or "") for name in one.opts}
        joined: list[str] = []
        for word in args:
            in_list = len(joined) > 1 and joined[-2] in lists
            if in_list and all(numbers_in(one.strip(", ")) for one in (joined[-1], word)):
                joined[-1] = f"{joined[-1].rstrip(', ')},{word}"
            else:
                joined.append(word)
        spread = []
        for before, word in zip([None, *joined], joined, strict=False):
            option, equals, value = word.partition("=")
            name, value = (option, value) if equals and option in counts else (before, word)
            parts = [part.strip() for part in value.split(",")]
            is_list = len(parts) > 1 and len(parts) == counts.get(name or "")
            spread += [*([option] if value != word else []), *parts] if is_list else [word]
        return super().parse_args(ctx, spread)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; its errors are printed as sentences."""
        with errors_as_sentences():
            return super().invoke(ctx)

    def get_short_help_str(self, limit: int = 45) -> str:
        """The whole first sentence; long lines are wrapped, not truncated."""
        del limit
        first = (self.help or "").strip().partition("\n\n")[0].partition(". ")[0]
        return self.short_help or f"{' '.join(first.split()).rstrip('.')}."


def numbers_in(word: str) -> list[float]:
    """Numbers separated by commas; none of them if one is no number."""
    try:
        return [float(part) for part in word.split(",")]
    except ValueError:
        return []
