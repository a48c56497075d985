"""`cnnum templates`: the library, listed, shown and checked."""

import click

from cnnum.cli.templates_check import check
from cnnum.cli.templates_list import list_templates
from cnnum.cli.templates_show import show


@click.group("templates", context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """List, show and check the template library."""


for _member in (list_templates, show, check):
    command.add_command(_member)
