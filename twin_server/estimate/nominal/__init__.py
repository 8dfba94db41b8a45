"""First epochs in; the nominal model that later readings are compared with out."""
