"""Lead time and windows of access in; when a repair takes effect, and the last order, out."""

from .access import Access
from .last_order import LastOrder, last_order_by_cost, last_order_by_probability

__all__ = ["Access", "LastOrder", "last_order_by_cost", "last_order_by_probability"]
