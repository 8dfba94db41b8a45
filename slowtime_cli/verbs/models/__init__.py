"""Arguments and help of the verbs in `slowtime_cli.models`."""
