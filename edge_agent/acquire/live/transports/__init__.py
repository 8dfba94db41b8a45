"""Ways on which samples come: one module each, imported when its scheme is used."""
