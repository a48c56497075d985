"""`cnnum templates list`."""

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, table


@click.command("list")
@click.option("--wide", is_flag=True, help="Also show sizes and checks.")
@json_option
def list_templates(wide: bool, as_json: bool) -> None:
    """List the templates of the library with their purpose."""
    from cnnum.templating.library import get_template, template_names, template_path

    output = Output(as_json)
    more = (">layers", ">inputs", ">radius", "check") if wide else ()
    listed = table("Template", "group", *more, "what it does")
    for name in template_names():
        template = get_template(name)
        group = template_path(name).parent.name
        summary = first_sentence(template.description)
        check = template.check.name if template.check else ""
        output.record(
            {
                "template": template.name,
                "group": group,
                "layers": template.layers,
                "inputs": template.inputs,
                "radius": template.radius,
                "check": check,
                "description": summary,
            }
        )
        sizes = [str(n) for n in (template.layers, template.inputs, template.radius)]
        listed.add_row(template.name, group, *((*sizes, check) if wide else ()), summary)
    output.show(listed, spare=() if wide else ("group",))


def first_sentence(text: str) -> str:
    """Return the first sentence of a description."""
    head, stop, _ = " ".join(text.split()).partition(". ")
    return head + "." if stop else head
