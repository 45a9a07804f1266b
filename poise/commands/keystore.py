"""`poise keystore`: keys, certificates and permissions of SROS 2 for the nodes of Poise."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from poise.errors import ErrorCode, InputError
from poise.keystore import add_enclave, read_policy


def keystore(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Keystore; made if missing.", show_default=False)],
    nodes: Annotated[
        list[str] | None, typer.Argument(metavar="[NODE|POLICY.xml]...", help="Nodes of Poise, or policy files.")
    ] = None,
    namespace: Annotated[str, typer.Option(help="Namespace of the nodes.")] = "/",
    domain: Annotated[int, typer.Option(min=0, max=232, help="ROS domain.")] = 0,
    remap: Annotated[
        list[str] | None, typer.Option(metavar="OLD:=NEW", help="Remapped name, as given to the node; repeatable.")
    ] = None,
) -> None:
    """Make an SROS 2 keystore with the least permissions that nodes need.

    Without NODE: all nodes of Poise. Each gets the enclave /poise/NODE.

    Example:  poise keystore ~/keystore ft_driver --remap wrench:=ft/wrench
    """
    if any(":=" not in one for one in remap or ()):
        raise InputError(ErrorCode.BAD_INPUT, "--remap takes OLD:=NEW, such as wrench:=ft/wrench")
    remaps = dict(one.split(":=", 1) for one in remap or ())
    for path in policy_files(nodes or []):
        for enclave, policies in read_policy(path, namespace, remaps).items():
            print(add_enclave(folder, enclave, policies, domain))


def policy_files(nodes: list[str]) -> list[Path]:
    """The policy files of these nodes of Poise, or files; of all nodes when none is named.

    Raises:
        InputError: BAD_INPUT for an unknown node.
    """
    prefixes = [prefix for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    shares = [Path(prefix) / "share" / "poise" for prefix in (*prefixes, sys.prefix)]  # colcon installs, pip installs
    folders = [root / "config" / "sros2" for root in (Path(__file__).resolve().parents[2], *shares)]
    shipped = next((folder for folder in folders if folder.is_dir()), folders[-1])
    known = {path.name.partition(".")[0]: path for path in sorted(shipped.glob("*.policy.xml"))}
    for node in nodes:
        if node not in known and not node.endswith(".xml"):
            raise InputError(ErrorCode.BAD_INPUT, f"no policy for {node!r}; there are {', '.join(known)}")
    return [known.get(node, Path(node)) for node in nodes] if nodes else list(known.values())
