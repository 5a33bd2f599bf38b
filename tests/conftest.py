from __future__ import annotations

from hypothesis import settings

# How long an example takes is no test's verdict. Every run draws other examples: fewer at a time keep the
# whole suite short, and `--hypothesis-profile=patient` tries many more.
settings.register_profile("untimed", deadline=None, max_examples=50)
settings.register_profile("patient", deadline=None, max_examples=1000)
settings.load_profile("untimed")
