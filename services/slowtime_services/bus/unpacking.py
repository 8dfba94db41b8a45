"""A bus on which batches arrive as the messages that were packed in them."""

from collections.abc import Callable

from slowtime_schemas.batches import is_batch, unpacked_or_whole
from slowtime_schemas.streams import FEATURES, is_of_features

from .forwarding import ForwardingBus
from .protocol import Handle, Sample

LARGEST_BATCH = FEATURES.max_bytes
"""Largest payload that is unpacked [bytes]; a larger one is left to be refused."""


class UnpackingBus(ForwardingBus):
    """Unpacks batches of features, so that receivers need not know of them.

    Parameters
    ----------
    bus
        Carries the messages; is closed with this one.
    """

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback` for each message, in the order in which the sender made them."""

        def each(sample: Sample) -> None:
            for one in unpacked(sample):
                callback(one)

        return self._bus.subscribe(key_expression, each)


def unpacked(sample: Sample) -> list[Sample]:
    """Return the messages of a batch of features; any other sample as it is.

    A batch that cannot be unpacked is returned as it is, for the receiver to refuse.
    """
    payload = sample.payload
    if not is_batch(payload) or len(payload) > LARGEST_BATCH or not is_of_features(sample.key):
        return [sample]
    return [sample._replace(payload=one) for one in unpacked_or_whole(payload)]
