"""Names of skinmap.live, from where they are defined: `skinmap/lazy.py` loads them on first use."""

from skinmap.live.contacts.named_touch import Moment as Moment
from skinmap.live.contacts.named_touch import NamedTouch as NamedTouch
from skinmap.live.loop import TouchLoop as TouchLoop
from skinmap.live.publishing.publish import open_publisher as open_publisher
from skinmap.live.sources.open_source import open_recording as open_recording
from skinmap.live.sources.open_source import open_source as open_source
from skinmap.live.sources.source import PolledSource as PolledSource
from skinmap.live.sources.source import Receiver as Receiver
from skinmap.live.sources.source import Relay as Relay
from skinmap.live.sources.source import Seekable as Seekable
from skinmap.live.sources.source import Source as Source
from skinmap.live.sources.source import check_source as check_source

__all__ = [
    "Moment",
    "NamedTouch",
    "PolledSource",
    "Receiver",
    "Relay",
    "Seekable",
    "Source",
    "TouchLoop",
    "check_source",
    "open_publisher",
    "open_recording",
    "open_source",
]
