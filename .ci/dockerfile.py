# SPDX-License-Identifier: MIT
r"""Build what a Dockerfile says in a folder, without Docker: the proof of docs/ci/Dockerfile where no engine runs.

    debootstrap --variant=minbase bookworm /tmp/root           # stands for FROM debian:bookworm-slim
    python .ci/dockerfile.py docs/ci/Dockerfile /tmp/root \
        --bind /etc/ssl/certs/ca-certificates.crt:/host/ca.crt --env PIP_CERT=/host/ca.crt

Runs as root. Each RUN is done in the folder by chroot, with the ENV, ARG, WORKDIR and USER before it; COPY takes from the
current folder what the .dockerignore beside the Dockerfile lets through. A mount namespace of its own keeps what is bound
(this machine's certificates and package indices, which are no part of the image) out of the rest of the system.

    python .ci/dockerfile.py docs/ci/Dockerfile /tmp/root --run --user 12345 --read-only -- map /work/office.bag

runs the built image's ENTRYPOINT with the words given, as any user, with everything but /tmp and /work (--work DIR) read-only.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Image:
    """What instructions have set so far."""

    root: Path
    environment: dict[str, str] = field(
        default_factory=lambda: {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
    )
    folder: str = "/"
    user: str = "root"
    entrypoint: list[str] = field(default_factory=list)


def instructions(text: str) -> Iterator[tuple[str, str]]:
    """Yield the name and the rest of each instruction; lines go on after a backslash, comments are left out."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    for line in re.sub(r"\\\n\s*", " ", "\n".join(lines)).splitlines():
        if line.strip():
            name, _, rest = line.strip().partition(" ")
            yield name.upper(), rest.strip()


def build(
    image: Image,
    text: str,
    context: Path,
    ignored: list[str],
    binds: list[str],
    arguments: dict[str, str],
    environment: dict[str, str],
    *,
    dry: bool,
) -> None:
    """Follow all instructions; `dry` only those that set something."""
    for name, rest in instructions(text):
        began = time.monotonic()
        if name == "ENV":
            pairs = [word.partition("=") for word in shlex.split(rest)]
            image.environment |= {key: os.path.expandvars(_resolve(value, image, arguments)) for key, _, value in pairs}
        elif name == "ARG":
            key, _, value = rest.partition("=")
            arguments.setdefault(key, value)
        elif name == "WORKDIR":
            image.folder = rest
            if not dry:
                (image.root / rest.lstrip("/")).mkdir(parents=True, exist_ok=True)
        elif name == "USER":
            image.user = rest
        elif name == "ENTRYPOINT":
            image.entrypoint = json.loads(rest)
        elif name == "RUN" and not dry:
            print(f"RUN {rest}", flush=True)
            command = _chroot(image, ["/bin/sh", "-c", rest], binds, arguments, environment)
            if subprocess.run(command, check=False).returncode:
                sys.exit(f"failed: RUN {rest}")
            print(f"    {time.monotonic() - began:.1f} s, {_size_mb(image.root)} MB", flush=True)
        elif name == "COPY" and not dry:
            *sources, target = rest.split()
            for source in sources:
                _copy(context / source, image.root / image.folder.lstrip("/") / target, context, ignored)
        elif name not in ("FROM", "CMD", "RUN", "COPY"):
            sys.exit(f"no way to do {name} here")


def _resolve(value: str, image: Image, arguments: dict[str, str]) -> str:
    known = image.environment | arguments
    return re.sub(r"\$\{?(\w+)\}?", lambda found: known.get(found[1], ""), value)


def _copy(source: Path, target: Path, context: Path, ignored: list[str]) -> None:
    """Copy a file into a folder, or what is in a folder, as COPY does."""
    files = [source] if source.is_file() else [path for path in sorted(source.rglob("*")) if path.is_file()]
    for file in files:
        if is_ignored(file.relative_to(context).as_posix(), ignored):
            continue
        place = target / (file.name if source.is_file() else file.relative_to(source))
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)


def is_ignored(name: str, patterns: list[str]) -> bool:
    """Return whether a .dockerignore leaves a file out: the last pattern that fits it or a folder above it decides."""
    parts = name.split("/")
    above = ["/".join(parts[: n + 1]) for n in range(len(parts))]
    ignored = False
    for pattern in patterns:
        wanted = pattern.removeprefix("!")
        anywhere = wanted.startswith("**/")
        fits = any(
            fnmatch.fnmatchcase(path.rpartition("/")[2] if anywhere else path, wanted.removeprefix("**/"))
            and (anywhere or path.count("/") == wanted.count("/"))
            for path in above
        )
        if fits:
            ignored = not pattern.startswith("!")
    return ignored


def _chroot(
    image: Image,
    command: list[str],
    binds: list[str],
    arguments: dict[str, str],
    environment: dict[str, str],
    *,
    user: str = "",
    work: str = "",
    read_only: bool = False,
) -> list[str]:
    """Return the command that runs another one in the image, in a mount namespace of its own."""
    root = shlex.quote(str(image.root))
    steps = [f"mount --bind {root} {root}", f"mount -t proc proc {root}/proc", f"mount --rbind /dev {root}/dev"]
    for bind in ["/etc/resolv.conf", *binds]:
        source, _, target = bind.partition(":")
        place = image.root / (target or source).lstrip("/")
        if Path(source).is_dir():
            place.mkdir(parents=True, exist_ok=True)
        else:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.touch()
        steps += [f"mount --bind {source} {place}", f"mount -o remount,ro,bind {place}"]
    steps += [f"mount -t tmpfs -o mode=1777 tmp {root}/tmp"] if read_only else []
    steps += [f"mount --bind {shlex.quote(work)} {root}/work"] if work else []
    steps += [f"mount -o remount,ro,bind {root}"] if read_only else []
    given = image.environment | (arguments if not user else {}) | environment
    words = ["env", "-i", *(f"{key}={value}" for key, value in given.items()), *command]
    inside = f"cd {image.folder} && exec {shlex.join(words)}"
    identity = f"--userspec={user}:{user} --groups= " if user else ""
    steps.append(f"exec chroot {identity}{root} /bin/sh -c {shlex.quote(inside)}")
    return ["unshare", "--mount", "sh", "-ec", "; ".join(steps)]


def _size_mb(root: Path) -> int:
    said = subprocess.run(["du", "-smx", str(root)], capture_output=True, text=True, check=False).stdout
    return int(said.split()[0])


def _split(words: list[str]) -> tuple[list[str], list[str]]:
    """Return the words before and after ``--``."""
    at = words.index("--") if "--" in words else len(words)
    return words[:at], words[at + 1 :]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dockerfile", type=Path)
    parser.add_argument("root", type=Path)
    parser.add_argument(
        "--bind",
        action="append",
        default=[],
        metavar="PATH[:TARGET]",
        help="file or folder of this machine that RUN sees",
    )
    parser.add_argument("--build-arg", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--run", action="store_true", help="run the built image instead of building it")
    parser.add_argument("--user", default="", help="number of the user who runs it")
    parser.add_argument(
        "--env", action="append", default=[], metavar="NAME=VALUE", help="of this machine, not of the image"
    )
    parser.add_argument("--work", default="", help="folder that is mounted at /work")
    parser.add_argument("--read-only", action="store_true")
    given, words = _split(sys.argv[1:])
    options = parser.parse_args(given)
    text = options.dockerfile.read_text()
    beside = options.dockerfile.with_name(f"{options.dockerfile.name}.dockerignore")
    ignored = [line.strip() for line in beside.read_text().splitlines() if line.strip() and not line.startswith("#")]
    arguments = dict(pair.split("=", 1) for pair in options.build_arg)
    image = Image(options.root.resolve())
    environment = dict(pair.split("=", 1) for pair in options.env)
    build(image, text, Path.cwd(), ignored, options.bind, arguments, environment, dry=options.run)
    if options.run:
        command = _chroot(
            image,
            [*image.entrypoint, *words],
            [],
            arguments,
            environment,
            user=options.user,
            work=options.work,
            read_only=options.read_only,
        )
        sys.exit(subprocess.run(command, check=False).returncode)


if __name__ == "__main__":
    main()
