"""Writes a copy of a controller whose normalizer has a floor of the standard deviation. The weights stay the same.

    python studies/experiments/tasks/normalizer_floor.py controllers/ball-balancing/ppo.safetensors 0.01 floor.safetensors
    mishandle evaluate ball-balancing --controller ./floor.safetensors --episodes 200 --seed 1 -k observation-noise=0.01

Prints the inputs whose standard deviation in training is below the floor. If the copy succeeds under observation noise and
the original does not, then the missing floor is the cause.
"""

import hashlib
import json
import math
import struct
import sys

SHA256 = b'sha256\\":\\"'


def main(source, floor, target):
    with open(source, "rb") as file:
        content = bytearray(file.read())
    (length,) = struct.unpack_from("<Q", content)
    header = json.loads(content[8 : 8 + length])
    layout = json.loads(header["__metadata__"]["mishandle"])["layout"]["observation"]
    names = [f"{part['name']}[{i}]" for part in layout for i in range(part["size"])]
    begin, _ = header["normalizer.variance"]["data_offsets"]
    place, numbers = 8 + length + begin, struct.Struct(f"<{len(names)}d")
    variances = numbers.unpack_from(content, place)
    for name, variance in zip(names, variances):
        if math.sqrt(variance) < floor:
            print(f"{name}: {math.sqrt(variance):.2g}")
    numbers.pack_into(content, place, *(max(variance, floor**2) for variance in variances))
    # The checksum is the hash of the file with zeros in its place.
    at = content.index(SHA256) + len(SHA256)
    content[at : at + 64] = b"0" * 64
    content[at : at + 64] = hashlib.sha256(content).hexdigest().encode()
    with open(target, "xb") as file:
        file.write(content)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), sys.argv[3])
