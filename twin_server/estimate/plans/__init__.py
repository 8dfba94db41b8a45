"""A forecast and the owner's costs in; a maintenance plan with its wording out."""
