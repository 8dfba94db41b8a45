"""Binary files in, named arrays out; compiled readers run in a process of their own."""
