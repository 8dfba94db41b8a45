"""Records in, records without faulty samples and the faults found out."""
