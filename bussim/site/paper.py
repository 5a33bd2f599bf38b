"""The form to print and fill in by hand."""

#: The languages that it is there in.
LANGUAGES = ("en", "zh")


def form_page(language: str) -> str:
    """The form as one HTML page for A4, in one of :data:`LANGUAGES`."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("bussim.site", "assets"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("form.html.jinja").render(lang=language)
