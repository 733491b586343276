#!/usr/bin/env python3
"""Fetches one file of the Python package index, checks its hash and unpacks the parts that are wanted.

usage: fetch.py PROJECT FILE SHA256 DOWNLOADS TARGET PATTERN...

Asks the index that pip is set up to use. A download that was interrupted goes on where it stopped. TARGET appears only
when everything is in it (unpacked beside it and renamed). PATTERN is a shell pattern over the paths in the archive;
`PATTERN:N` drops the first N folders of the path. Standard library and pip's settings only.
"""
import fnmatch
import hashlib
import json
import os
import shutil
import ssl
import stat
import subprocess
import sys
import tarfile
import time
import urllib.error
import urllib.parse
import urllib.request
import zipfile


class Problem(Exception):
    """A sentence for the person; printed without a trace."""


def index_url():
    """The index pip would ask: its environment variable, its settings, its default."""
    if os.environ.get("PIP_INDEX_URL"):
        return os.environ["PIP_INDEX_URL"]
    answer = subprocess.run([sys.executable, "-m", "pip", "config", "get", "global.index-url"], capture_output=True, text=True)
    if answer.returncode == 0 and answer.stdout.strip():
        return answer.stdout.strip()
    try:
        from pip._internal.models.index import PyPI
    except ImportError:
        raise Problem("pip is missing; install it: apt-get install python3-pip")
    return PyPI.simple_url


def open_url(url, headers):
    context = ssl.create_default_context(cafile=os.environ.get("PIP_CERT") or os.environ.get("SSL_CERT_FILE") or None)
    return urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60, context=context)


def locate(project, file):
    url = f"{index_url().rstrip('/')}/{project}/"
    try:
        with open_url(url, {"Accept": "application/vnd.pypi.simple.v1+json"}) as answer:
            listing = json.load(answer)
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise Problem(f"no network, or the package index does not answer ({error}); connect and run ./ars again, "
                      f"or set PIP_INDEX_URL to an index that this machine reaches")
    for entry in listing.get("files", []):
        if entry["filename"] == file:
            return urllib.parse.urljoin(url, entry["url"]), entry.get("size")
    raise Problem(f"the package index has no {file}")


def digest(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() if hasattr(hashlib, "file_digest") else \
            hashlib.sha256(file.read()).hexdigest()


def need_space(folder, count, what):
    free = shutil.disk_usage(folder).free
    if free < count:
        raise Problem(f"disk full: {what} needs {count >> 20} MiB in {folder}, {free >> 20} MiB are free")


def show(done, total, start, last):
    """One line that is rewritten on a terminal, a plain line every ten percent elsewhere."""
    percent = 100 * done // max(total, 1)
    rate = done / max(time.time() - start, 1e-3) / 2**20
    if sys.stderr.isatty():
        print(f"\r    {done >> 20} of {total >> 20} MiB  {percent} %  {rate:.0f} MiB/s   ", end="", file=sys.stderr)
    elif percent // 10 > last // 10:
        print(f"    {percent} %", file=sys.stderr)
    return percent


def download(project, file, sha256, folder):
    path = os.path.join(folder, file)
    if os.path.exists(path) and digest(path) == sha256:
        return path
    os.makedirs(folder, exist_ok=True)
    url, size = locate(project, file)
    part = path + ".part"
    for attempt in range(5):
        have = os.path.getsize(part) if os.path.exists(part) else 0
        if size and have > size:
            os.remove(part)
            have = 0
        if size and have == size:
            break
        need_space(folder, (size or 0) - have + (64 << 20), file)
        headers = {"Range": f"bytes={have}-"} if have else {}
        try:
            with open_url(url, headers) as answer, open(part, "ab" if have and answer.status == 206 else "wb") as out:
                done = have if answer.status == 206 else 0
                total = size or done + int(answer.headers.get("Content-Length", 0))
                start, last = time.time(), -1
                while chunk := answer.read(1 << 20):
                    out.write(chunk)
                    done += len(chunk)
                    last = show(done, total, start, last)
            if sys.stderr.isatty():
                print(file=sys.stderr)
            if not size or done == size:
                break
        except (urllib.error.URLError, TimeoutError, ConnectionError) as error:
            print(f"    interrupted ({error}); trying again", file=sys.stderr)
            time.sleep(2 * (attempt + 1))
    else:
        raise Problem(f"{file} could not be fetched whole; the part that came is kept, run ./ars again to go on")
    if digest(part) != sha256:
        os.remove(part)
        raise Problem(f"{file} does not have the expected SHA-256; it was removed, run ./ars again")
    os.rename(part, path)
    return path


def members(path):
    """(name, size, mode, opener) of every regular file of a zip or tar."""
    if path.endswith((".whl", ".zip")):
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                if not info.is_dir():
                    yield info.filename, info.file_size, info.external_attr >> 16, lambda i=info: archive.open(i)
    else:
        with tarfile.open(path) as archive:
            for info in archive:
                if info.isfile():
                    yield info.name, info.size, info.mode, lambda i=info: archive.extractfile(i)


def unpack(path, target, patterns):
    fresh = target + ".new"
    shutil.rmtree(fresh, ignore_errors=True)
    os.makedirs(fresh)
    rules = [(p.rpartition(":")[0], int(p.rpartition(":")[2])) if p.rpartition(":")[2].isdigit() else (p, 0)
             for p in patterns]
    count = 0
    for name, size, mode, opener in members(path):
        for pattern, drop in rules:
            if not fnmatch.fnmatch(name, pattern):
                continue
            kept = "/".join(name.split("/")[drop:])
            place = os.path.normpath(os.path.join(fresh, kept))
            if not place.startswith(fresh + os.sep):
                raise Problem(f"{path}: the archive holds an unsafe path: {name}")
            os.makedirs(os.path.dirname(place), exist_ok=True)
            need_space(fresh, size + (16 << 20), name)
            with opener() as source, open(place, "wb") as out:
                shutil.copyfileobj(source, out, 1 << 20)
            if mode & stat.S_IXUSR:
                os.chmod(place, 0o755)
            count += 1
            break
    if not count:
        raise Problem(f"{path}: nothing in it matches {' '.join(patterns)}")
    shutil.rmtree(target, ignore_errors=True)
    os.rename(fresh, target)
    return count


def main():
    if len(sys.argv) < 7:
        raise Problem(__doc__.split("\n\n")[1])
    project, file, sha256, downloads, target, *patterns = sys.argv[1:]
    path = download(project, file, sha256, downloads)
    print(f"    {unpack(path, os.path.abspath(target), patterns)} files -> {target}", file=sys.stderr)
    if not os.environ.get("ARS_KEEP_DOWNLOADS"):
        os.remove(path)


if __name__ == "__main__":
    try:
        main()
    except Problem as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        print(f"error: {error.filename or ''}: {error.strerror}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("\nstopped; ./ars goes on from here", file=sys.stderr)
        sys.exit(130)
