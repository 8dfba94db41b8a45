"""New readings and raw samples in; changes of a model and its free-run error out."""
