"""Names of servers in settings → connections to addresses that were looked up once."""
