"""Writes the log of the tests with the tools that users have. Each file has the same samples: time, force, and a list `q`
of two joints where the tool has lists.

    pip install polars==2.1.0 pandas==3.1.1 pyarrow==26.0.1 numpy==2.4.6
    python crates/logs/tests/data/make.py
"""

import pathlib

import numpy
import pandas
import polars
import pyarrow
import pyarrow.parquet

HERE = pathlib.Path(__file__).parent
TIME = [0.0, 0.1, 0.2, 0.3]
FORCE = [0.5, 1.5, 2.5, 1.0]
Q = [[1.0, -1.0], [2.0, -2.0], [3.0, -3.0], [4.0, -4.0]]
STAMPS = pandas.to_datetime([1_700_000_000_000_000_000 + int(1e8) * i for i in range(4)], utc=True)

frame = pandas.DataFrame({"time": TIME, "force": FORCE})
frame.to_csv(HERE / "pandas.csv")
frame.to_csv(HERE / "pandas_comma.csv", sep=";", decimal=",", index=False)
frame.to_json(HERE / "pandas.jsonl", orient="records", lines=True)
frame.to_parquet(HERE / "pandas.parquet")
frame.assign(time=STAMPS).to_parquet(HERE / "pandas_stamps.parquet")
frame.assign(time=STAMPS).to_csv(HERE / "pandas_stamps.csv", index=False)
polars.DataFrame({"time": TIME, "force": FORCE, "q": Q}).write_parquet(HERE / "polars.parquet")
table = pyarrow.table({
    "time": pyarrow.array(TIME),
    "force": pyarrow.array(FORCE, pyarrow.float32()),
    "q": pyarrow.array(Q, pyarrow.list_(pyarrow.float64(), 2)),
    "pose": pyarrow.array([{"position": {"x": x}} for x in FORCE]),
})
for compression in ["none", "gzip", "zstd", "lz4"]:
    pyarrow.parquet.write_table(table, HERE / f"pyarrow_{compression}.parquet", compression=compression)
numpy.savez(HERE / "numpy.npz", time=TIME, force=FORCE, q=Q)
numpy.savez_compressed(HERE / "numpy_compressed.npz", time=TIME, force=numpy.array(FORCE, "f4"), q=numpy.asfortranarray(Q))
numpy.savetxt(HERE / "numpy.txt", numpy.column_stack([TIME, FORCE]), header="time force")
