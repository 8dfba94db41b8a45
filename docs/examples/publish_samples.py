"""Publish samples for `slowtime edge --source zenoh:`, with nothing but Zenoh."""

import hashlib
import json
import math
import time

import zenoh

site, asset, rate_hz, count = "lab", "bridge", 100.0, 20
partition = hashlib.sha256(asset.encode()).digest()[0]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["tcp/127.0.0.1:7447"]')
with zenoh.open(config) as session:
    for n in range(0, 10**9, count):
        rows = [[math.sin(2 * math.pi * 3.2 * (n + i) / rate_hz)] for i in range(count)]
        message = {"version": 1, "site": site, "asset": asset, "boot": "run-1", "sequence": n}
        message |= {"t_ns": time.time_ns(), "rate_hz": rate_hz, "first_index": n}
        message |= {"channels": ["z"], "units": ["m/s^2"], "samples": rows}
        session.put(f"slowtime/v2/{site}/samples/{partition}/{asset}", json.dumps(message))
        time.sleep(count / rate_hz)
