"""Quantities computed from records: virtual sensors, fatigue, distortion, orders, constants."""
