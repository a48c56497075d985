"""`cnnum templates`: the library, listed, shown and checked."""

import click

from cnnum.cli.commands.templates_check import check
from cnnum.cli.commands.templates_convert import export, import_files
from cnnum.cli.commands.templates_design import design
from cnnum.cli.commands.templates_find import compare, find, list_templates
from cnnum.cli.commands.templates_measure import analyse, audit, measure
from cnnum.cli.commands.templates_show import gallery, show


@click.group(
    "templates",
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.pass_context
def command(ctx: click.Context) -> None:
    """List, show and check the template library."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


_MEMBERS = (
    *(list_templates, find, show, compare, analyse, check, design, measure, audit, gallery),
    *(import_files, export),
)

for _member in _MEMBERS:
    command.add_command(_member)
