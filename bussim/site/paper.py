"""The form to print and fill in by hand."""

from importlib.resources import files


def form_page(language: str) -> str:
    """The form as one HTML page for A4, in one of :data:`~bussim.words.tables.LANGUAGES`."""
    from bussim.report.document import environment

    template = files("bussim.site").joinpath("assets/form.html.jinja").read_text(encoding="utf-8")
    return environment().from_string(template).render(lang=language) + "\n"
