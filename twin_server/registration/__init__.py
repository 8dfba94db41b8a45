"""The registration of a twin: nominal structure, alarms, costs and limit states."""
