"""Writes the bill of materials (CycloneDX 1.6, JSON) of the environment it is run in: `python .ci/sbom.py sbom.json`.

gcs-mosaic, each package that it needs as far as it is installed here, with version, licence and who needs whom, and what is
vendored in it. The same environment gives the same bytes; SOURCE_DATE_EPOCH dates it.
"""

from __future__ import annotations

import json
import os
import re
import sys
from datetime import UTC, datetime
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import quote

OURS = "gcs-mosaic"
LEAFLET = re.compile(rb"Leaflet (\d+\.\d+\.\d+)")


def main() -> None:
    """Write the file named on the command line."""
    found = installed(OURS)
    ours = found.pop(OURS)
    when = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), UTC).isoformat()
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"timestamp": when, "component": component(ours) | {"type": "application"}},
        "components": [*(component(one) for one in found.values()), leaflet()],
        "dependencies": [
            *(needs(one, {OURS: ours, **found}) for one in (ours, *found.values())),
            {"ref": leaflet()["bom-ref"], "dependsOn": []},
        ],
    }
    Path(sys.argv[1]).write_text(json.dumps(bill, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def installed(name: str) -> dict[str, Distribution]:
    """A package and all that it needs, whatever of that is here, by name in order."""
    found, wanted = dict[str, Distribution](), [name]
    while wanted:
        one = wanted.pop()
        try:
            if one not in found:
                found[one] = distribution(one)
                wanted += requirements(found[one])
        except PackageNotFoundError:
            continue  # an extra, or for another system
    return dict(sorted(found.items()))


def requirements(package: Distribution) -> list[str]:
    """The names of what a package needs without its extras for development."""
    lines = [line for line in package.requires or [] if not re.search(r"extra == ['\"](dev|fuzz|benchmark)", line)]
    extras = [line for line in lines if "extra ==" in line and normalised(package.name) != OURS]
    return sorted({normalised(re.split(r"[^\w.-]", line)[0]) for line in lines if line not in extras})


def component(package: Distribution) -> dict[str, Any]:
    """A package as a component."""
    told = package.metadata.json  # with field names in small letters
    licence = told.get("license_expression") or told.get("license") or "; ".join(classified(package))
    name = normalised(package.name)
    return {
        "type": "library",
        "bom-ref": reference(package),
        "name": name,
        "version": package.version,
        "purl": reference(package),
        "licenses": [named(" ".join(str(licence).split())[:100], expression="license_expression" in told)]
        if licence
        else [],
    }


def named(licence: str, *, expression: bool) -> dict[str, Any]:
    """A licence, as an SPDX expression where the package tells one."""
    return {"expression": licence} if expression else {"license": {"name": licence}}


def classified(package: Distribution) -> list[str]:
    """The licences that a package's classifiers name."""
    told = package.metadata.get_all("Classifier") or []
    return [one.rpartition(" :: ")[2] for one in told if one.startswith("License ::")]


def needs(package: Distribution, found: dict[str, Distribution]) -> dict[str, Any]:
    """Whom a package needs, of those that are here."""
    refs = [reference(found[name]) for name in requirements(package) if name in found]
    more = [leaflet()["bom-ref"]] if normalised(package.name) == OURS else []
    return {"ref": reference(package), "dependsOn": sorted([*refs, *more])}


def leaflet() -> dict[str, Any]:
    """What is vendored; its version is the one that its own file tells."""
    import gcs_mosaic

    script = Path(gcs_mosaic.__file__).parent / "web" / "viewer" / "vendor" / "leaflet" / "leaflet.js"
    told = LEAFLET.search(script.read_bytes())
    assert told, "the file tells no version"
    version = told[1].decode()
    purl = f"pkg:npm/leaflet@{version}"
    licences = [{"expression": "BSD-2-Clause"}]
    return {
        "type": "library",
        "bom-ref": purl,
        "name": "leaflet",
        "version": version,
        "purl": purl,
        "licenses": licences,
    }


def reference(package: Distribution) -> str:
    return f"pkg:pypi/{normalised(package.name)}@{quote(package.version)}"


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


if __name__ == "__main__":
    main()
