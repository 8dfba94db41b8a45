"""Sends events to an installed plug-in, in a process of its own."""

from slowtime_services.plugins import PluginError, find
from slowtime_services.plugins.plugin_process import PluginProcess
from twin_server.events.receivers import OwnReceiver

from .message import Message, NotDeliveredError

GROUP = "slowtime.alarms"


class PluginSender:
    """Sends to one receiver; one message at a time, as there is one process.

    Raises
    ------
    NotDeliveredError
        Where the part is not installed.
    """

    def __init__(self, receiver: OwnReceiver) -> None:
        self._receiver = receiver
        try:
            self._process = PluginProcess(find(GROUP, receiver.part))
        except PluginError as error:
            raise NotDeliveredError(str(error)) from error

    def check(self) -> None:
        """Check nothing: a plug-in that cannot be imported fails when it is sent to."""

    def send(self, message: Message) -> str:
        """Send; return the plug-in's answer.

        Raises
        ------
        NotDeliveredError
            Where the part raised, ended or took longer than `timeout_s`.
        """
        given = self._receiver
        try:
            told = self._process.ask(
                message.content, dict(given.options), timeout_s=given.timeout_s
            )
        except PluginError as error:
            raise NotDeliveredError(str(error)) from error
        return "" if told is None else str(told)[:200]
