"""Pages for people: HTML from templates that share one style and load nothing from elsewhere."""

from functools import cache
from typing import Any

from jinja2 import (
    ChoiceLoader,
    Environment,
    PackageLoader,
    StrictUndefined,
)


def render(
    package: str,
    template: str,
    **values: Any,
) -> str:
    """A page as HTML text.

    Args:
        package: The package whose folder `templates` holds the template.
        template: Its name; it may include `style.css`.
        values: What the template names; text in them is escaped.
    """
    return _templates(package).get_template(template).render(**values)


@cache
def _templates(package: str) -> Environment:
    """The templates of a package, each of which is compiled once."""
    return Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader(__name__)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
