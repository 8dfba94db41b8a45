"""A bus of which only the messages of some assets arrive."""

from collections.abc import Callable

from slowtime_schemas.streams import address_of

from .forwarding import ForwardingBus
from .protocol import Bus, Handle, Sample


class PartialBus(ForwardingBus):
    """Passes messages and liveliness of some assets, and everything that is of no asset.

    What is sent, asked and answered is not restricted.

    Parameters
    ----------
    bus
        The whole bus; closing this one closes it.
    has
        Whether an asset is among those whose messages pass.
    """

    def __init__(self, bus: Bus, has: Callable[[str], bool]) -> None:
        super().__init__(bus)
        self._has = has

    def _passes(self, key: str) -> bool:
        address = address_of(key)
        return address is None or self._has(address[1])

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback` for each message of the assets."""

        def passing(sample: Sample) -> None:
            if self._passes(sample.key):
                callback(sample)

        return self._bus.subscribe(key_expression, passing)

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call `callback(key, alive)` for each process of the assets."""

        def passing(key: str, alive: bool) -> None:
            if self._passes(key):
                callback(key, alive)

        return self._bus.watch(key_expression, passing)
