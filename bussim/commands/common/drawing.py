"""What commands draw with."""


def import_matplotlib() -> None:
    """Import what draws pictures, without what takes half of that time: docstrings that list all properties.

    For commands only: who draws from Python may want to read them.
    """
    from matplotlib import artist

    listed = artist.kwdoc
    artist.kwdoc = lambda artist: ""  # noqa: ARG005 - matplotlib names it so
    try:
        import bussim.results.plots.style  # noqa: F401 - what it imports stays
    finally:
        artist.kwdoc = listed
