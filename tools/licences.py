#!/usr/bin/env python3
"""Licences of the crates that programs are made of: a table, and the texts that they bring.

    cargo metadata --format-version 1 | tools/licences.py FOLDER PACKAGE...

Follows the dependencies of these packages of the working tree. Dependencies of builds and tests alone are left out.
"""

import json
import pathlib
import shutil
import sys

NAMES = ("licen", "copying", "notice", "copyright", "unlicense")


def needed(metadata, names):
    """Packages that end up in the programs of these packages, by name."""
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    ours = {package["name"]: package["id"] for package in packages.values() if package["source"] is None}
    left = [ours[name] for name in names]
    found = set()
    while left:
        package = left.pop()
        if package in found:
            continue
        found.add(package)
        for dependency in nodes[package]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                left.append(dependency["pkg"])
    return sorted((packages[package] for package in found), key=lambda package: (package["name"], package["version"]))


def main():
    folder = pathlib.Path(sys.argv[1])
    rows, without = [], []
    for package in needed(json.load(sys.stdin), sys.argv[2:]):
        if package["source"] is None:
            continue
        label = f"{package['name']}-{package['version']}"
        source = pathlib.Path(package["manifest_path"]).parent
        texts = [path for path in source.iterdir() if path.is_file() and path.name.lower().startswith(NAMES)]
        for text in texts:
            shutil.copyfile(text, folder / f"{label}.{text.name}")
        if not texts:
            without.append(label)
        rows.append(f"| {package['name']} | {package['version']} | {package['license'] or 'see its text'} | {package['repository'] or ''} |")
    table = ["# Crates in these programs", "", "| crate | version | licence | source |", "|---|---|---|---|", *rows, ""]
    if without:
        table += ["These bring no text of their own; the licence named above holds: " + ", ".join(without) + ".", ""]
    (folder / "README.md").write_text("\n".join(table))


main()
