"""Serves a simulator in Python to Mishandle: docs/guide/simulator_clients.md. Python 3.8 or later, no dependency."""
import json, math, os, sys, traceback

def serve(hello, simulate=None, reset=None, step=None):
    """Answers Mishandle until it closes standard input.

    `simulate(scenario, seed)`, or `reset(scenario, seed)` and `step(action)`, return an answer of the protocol without
    its id: {"trace": {"level": [...]}}, or {"signals": [...]}, and "observation", "end" and "reason" where they apply.
    """
    if (simulate is None) == (reset is None) or (reset is None) != (step is None):
        raise TypeError("serve needs simulate=, or reset= and step=")
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    questions = os.fdopen(os.dup(0), encoding="utf-8")
    # What libraries and children print goes to standard error, and they cannot read questions.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    known = {"hello": lambda question: {"protocol": 1, "mode": "step" if step else "trace", **hello}}
    if simulate:
        known["simulate"] = lambda question: simulate(question["scenario"], int(question["seed"]))
    else:
        known["reset"] = lambda question: reset(question["scenario"], int(question["seed"]))
        known["step"] = lambda question: step(question.get("action"))
    for line in questions:
        question = json.loads(line)
        try:
            if question["type"] not in known:
                raise ValueError(f"unknown type of question `{question['type']}`; expected one of {', '.join(known)}")
            answer = json.dumps({"id": question["id"], **_plain(known[question["type"]](question))}, allow_nan=False)
        except Exception as error:
            traceback.print_exc()
            answer = json.dumps({"id": question["id"], "error": f"{type(error).__name__}: {error}"})
        print(answer, file=answers, flush=True)

def _plain(value):  # NumPy's numbers and arrays become Python's, NaN and infinities None.
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return {key: _plain(each) for key, each in value.items()} if isinstance(value, dict) else \
        None if isinstance(value, float) and not math.isfinite(value) else value
