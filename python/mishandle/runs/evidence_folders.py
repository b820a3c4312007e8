"""Folders of runs that others can verify."""

from __future__ import annotations

import os
from collections.abc import Sequence

import mishandle._native as _native
from mishandle.base.files import PathLike
from mishandle.errors import InvalidValueError
from mishandle.results import Evidence, EvidenceVerification
from mishandle.runs.documents import read


def evidence(
    runs: Sequence[PathLike], out: PathLike, *, key: PathLike | None = None, force: bool = False,
    controller: str | None = None, target: str | None = None
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
    controller, target : path, optional
        Present paths of the runs' controller and target file, if they were moved.

    Examples
    --------
    >>> import tempfile
    >>> from mishandle import falsify
    >>> from mishandle.runs import verify_evidence
    >>> folder = tempfile.mkdtemp()
    >>> found = falsify("toy/sphere-2d", trials=1, budget=30, out=folder + "/run.sqlite")
    >>> [run.page for run in evidence([found.path], folder + "/evidence").runs]
    ['pages/run.html']
    >>> verified = verify_evidence(folder + "/evidence", share=1.0)
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
        key=None if key is None else os.fspath(key), force=force, controller=controller,
        target=target
    )
    return read(Evidence, text)


def verify_evidence(
    folder: PathLike, *, allowed_signers: PathLike | None = None,
    public_key: PathLike | None = None, share: float = 0.05, seed: int | None = None
) -> EvidenceVerification:
    """Checks signature, hashes and run files of a folder that somebody else made, and replays a
    random share of its simulations.

    What is wrong is part of the result: ``is_verified`` and ``problems``; ``unverified`` has what
    cannot be checked. Nothing is written, and no program but ``ssh-keygen`` is started, which
    checks the signature. Systems in Python are not replayed, because their code is not in the
    folder, so ``is_verified`` is false unless ``share`` is 0: pass the system to :func:`replay`.

    Parameters
    ----------
    folder : path
        Folder of :func:`evidence` or of ``mishandle evidence``.
    allowed_signers : path, optional
        File of keys whose signatures count, with a line ``NAME KEY`` for each, as for ``ssh-keygen
        -Y verify``.
    public_key : path, optional
        The one public key whose signature counts.
    share : float
        Share of the simulations of each run to replay, at least one; 0 for none.
    seed : int, optional
        Chooses the simulations; by default a random one, which the result contains.
    """
    if not 0 <= share <= 1:
        raise InvalidValueError(f"share is {share}; it must be from 0 to 1")
    if allowed_signers is not None and public_key is not None:
        raise InvalidValueError("give either allowed_signers or public_key")
    text = _native.verify_evidence(
        os.fspath(folder),
        allowed_signers=None if allowed_signers is None else os.fspath(allowed_signers),
        public_key=None if public_key is None else os.fspath(public_key), share=share, seed=seed
    )
    return read(EvidenceVerification, text)
