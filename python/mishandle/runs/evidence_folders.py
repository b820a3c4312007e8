"""Folders of runs that others can verify."""

import os
from collections.abc import Sequence

import mishandle._native as _native
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike
from mishandle.errors import InvalidValueError
from mishandle.results import Evidence, EvidenceVerification
from mishandle.runs.documents import read


def evidence(
    runs: Sequence[PathLike], out: PathLike, *, key: PathLike | None = None, force: bool = False,
    plan: Plan | None = None
) -> Evidence:
    """Writes a folder with run files, pages, the files that simulations need, and hashes of all,
    which others can verify.

    Parameters
    ----------
    runs : sequence of path
        Run files, and folders of :func:`mishandle.check`.
    out : path
        The folder, which must not exist.
    key : path, optional
        Key with which ``ssh-keygen`` signs; one with a passphrase must be in an ``ssh-agent``.
        Without it, hashes show accidents, not forgery.
    force : bool
        Replace ``out`` if it is a folder of evidence with no other file.
    plan : dict, optional
        Rare settings: ``controller`` and ``target`` of the table ``engine`` are the present paths
        of the runs' controller and target file, if they were moved.

    Examples
    --------
    >>> import tempfile
    >>> from mishandle import falsify
    >>> from mishandle.runs import verify_evidence
    >>> folder = tempfile.mkdtemp()
    >>> found = falsify("toy/sphere-2d", trials=1, budget=30, out=folder + "/run.sqlite")
    >>> [run.page for run in evidence([found.path], folder + "/evidence").runs]
    ['pages/run.html']
    >>> verified = verify_evidence(folder + "/evidence", plan={"evidence": {"replay": 1.0}})
    >>> (
    ...     verified.is_verified, verified.signature,
    ...     len(verified.runs[0].replayed) == verified.runs[0].chosen
    ... )
    (True, 'missing', True)
    """
    if isinstance(runs, (str, os.PathLike)):
        raise InvalidValueError(f"runs is {os.fspath(runs)!r}; it must be a list of run files")
    text = _native.evidence(
        [os.fspath(run) for run in runs], os.fspath(out),
        Call("evidence", {"plan": plan}).text(), key=None if key is None else os.fspath(key),
        force=force
    )
    return read(Evidence, text)


def verify_evidence(
    folder: PathLike, *, allowed_signers: PathLike | None = None,
    public_key: PathLike | None = None, seed: int | None = None, plan: Plan | None = None
) -> EvidenceVerification:
    """Checks signature, hashes and run files of a folder that somebody else made, and replays a
    random share of its simulations.

    What is wrong is part of the result: ``is_verified`` and ``problems``; ``unverified`` has what
    cannot be checked. Nothing is written, and no program but ``ssh-keygen`` is started, which
    checks the signature. Systems in Python are not replayed, because their code is not in the
    folder, so ``is_verified`` is false unless none is replayed: pass the system to :func:`replay`.

    Parameters
    ----------
    folder : path
        Folder of :func:`evidence` or of ``mishandle evidence``.
    allowed_signers : path, optional
        File of keys whose signatures count, with a line ``NAME KEY`` for each, as for ``ssh-keygen
        -Y verify``.
    public_key : path, optional
        The one public key whose signature counts.
    seed : int, optional
        Chooses the simulations; by default a random one, which the result contains.
    plan : dict, optional
        Rare settings: ``{"evidence": {"replay": 0.05}}`` is the share of the simulations of each
        run to replay, at least one; 0 for none.
    """
    if allowed_signers is not None and public_key is not None:
        raise InvalidValueError("give either allowed_signers or public_key")
    text = _native.verify_evidence(
        os.fspath(folder), Call("verify_evidence", {"plan": plan}).text(),
        allowed_signers=None if allowed_signers is None else os.fspath(allowed_signers),
        public_key=None if public_key is None else os.fspath(public_key), seed=seed
    )
    return read(EvidenceVerification, text)
