"""What is wrong with a recording."""

from bussim.errors import UsageError


class RecordingError(UsageError):
    """A file that cannot be read as a recording. The message names its line or byte."""
