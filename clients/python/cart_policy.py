"""A policy for the cart, as a program: it drives the cart to the middle of the rail."""

import json
import sys

for line in sys.stdin:
    question = json.loads(line)
    position, velocity = question["observation"]
    print(json.dumps({"id": question["id"], "action": [-2.0 * position - 1.5 * velocity]}), flush=True)
