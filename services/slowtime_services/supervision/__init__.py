"""A process → signs of life, a watcher that ends it without them, notices to systemd."""

from .heartbeat import BEAT_S, Heartbeat, WatchReport
from .stacks import all_stacks
from .systemd import notify, watchdog_s

__all__ = ["BEAT_S", "Heartbeat", "WatchReport", "all_stacks", "notify", "watchdog_s"]
