"""Single events of shaking: where they lie in a record, and how strong they are."""
