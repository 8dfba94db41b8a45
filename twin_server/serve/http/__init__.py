"""HTTP machinery: connection limits, queues, threads and problem documents."""
