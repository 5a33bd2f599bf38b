"""Error codes of the N:N link (FX communication manual JY992D69901 rev. E, chapters 4 and 12.2).

The numbers are hexadecimal as the manual prints them: code 21 is stored as 0x21.
"""

from typing import Final

NO_REPLY: Final = 0x01  # master, about a slave: no reply within the timeout
WRONG_STATION: Final = 0x02  # master, about a slave: the station number does not agree
WRONG_COUNTER: Final = 0x03  # master, about a slave: the communication counter does not agree
DAMAGED: Final = 0x04  # master and slaves, about a slave: the reply's format is wrong
MASTER_SILENT: Final = 0x11  # slave, about the master: its requests stopped
MASTER_DAMAGED: Final = 0x14  # slave, about the master: its message format is wrong
NOT_IN_NETWORK: Final = 0x21  # slave, about another: its poll got no reply
HEARD_WRONG_STATION: Final = 0x22  # slave, about another: the station number disagrees
HEARD_WRONG_COUNTER: Final = 0x23  # slave, about another: the counter disagrees
NO_PARAMETERS: Final = 0x31  # slave, about itself: polled before it received parameters

#: The meaning of each code, in words.
MEANINGS: Final[dict[int, str]] = {
    NO_REPLY: "no reply",
    WRONG_STATION: "wrong station",
    WRONG_COUNTER: "wrong counter",
    DAMAGED: "damaged",
    MASTER_SILENT: "master silent",
    MASTER_DAMAGED: "master's frame damaged",
    NOT_IN_NETWORK: "not in the network",
    HEARD_WRONG_STATION: "wrong station",
    HEARD_WRONG_COUNTER: "wrong counter",
    NO_PARAMETERS: "polled without parameters",
}

#: Counters stop here (assumed).
COUNT_LIMIT: Final = 32767
