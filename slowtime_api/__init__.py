"""The Python interface: what ``import slowtime`` offers, over records, models and twins."""
