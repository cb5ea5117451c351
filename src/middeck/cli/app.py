"""The group of verbs; a verb's module is imported when it is asked for."""

from difflib import get_close_matches
from importlib import import_module

import click

from middeck import __version__
from middeck.cli.options import HELP

# In the order of the work.
VERBS = (
    *("new", "study", "convert", "reduce", "check", "level", "modes", "compare", "budget", "path"),
    *("sensitivity", "correlate", "refine", "candidates", "promise", "outcome"),
    *("response", "excite", "record", "identify", "impact", "drift"),
    *("design", "qualify", "generate", "gate", "doctor"),
)

EXAMPLES = """\
\b
Examples:
  middeck new boom
  middeck study studies/mace-1993.toml -o out/mace-1993

\b
--set key=value overrides any input value by the name it has in its file.
Exit codes: 0 done, 1 the answer is no (--require), 2 usage or configuration,
3 an optional package is missing, 4 bad data, 5 numerical failure,
70 a fault of middeck, 130 interrupted.
Manual: README.md and docs/ of the source; `middeck VERB --help` for a verb.
"""


class Verbs(click.Group):
    """Finds verbs by name in `middeck.cli.verbs`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The verbs in the order of the work."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb's click command, imported now."""
        if cmd_name not in VERBS:
            return None
        return import_module(f"middeck.cli.verbs.{cmd_name}").verb

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The verb that was typed; fails with the nearest name."""
        if args and not args[0].startswith("-") and args[0] not in VERBS:
            near = get_close_matches(args[0], VERBS, 1)
            ctx.fail(f"no verb {args[0]!r}" + (f"; did you mean {near[0]!r}?" if near else ""))
        return super().resolve_command(ctx, args)


def verb_options(verb: str) -> tuple[str, ...]:
    """Every option of a verb, as it is typed."""
    command: click.Command = import_module(f"middeck.cli.verbs.{verb}").verb
    found = [p for p in command.params if isinstance(p, click.Option)]
    return tuple(name for p in found for name in (*p.opts, *p.secondary_opts))


app = click.version_option(__version__, prog_name="middeck")(
    Verbs(
        "middeck",
        help="Control of flexible structures that must work where they cannot be tested.",
        epilog=EXAMPLES,
        context_settings=HELP,
    )
)
