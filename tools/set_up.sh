#!/usr/bin/env bash
# Makes .venv with Poise and the extras named in $1 (viewer,test); does nothing when that is already there.
set -euo pipefail
cd "$(dirname "$0")/.."
extras=${1:-viewer}
venv=.venv

# What has to be on the system already: a Python with venv, and a compiler for the interfaces.
find_python() {
  local name
  for name in python3.12 python3.11 python3; do
    if command -v "$name" >/dev/null && "$name" -c 'import sys; sys.exit(sys.version_info[:2] not in {(3, 11), (3, 12)})' 2>/dev/null; then
      command -v "$name"; return
    fi
  done
}
missing=()
python=$(find_python)
if [ -z "$python" ]; then
  missing+=(python3 python3-venv)
elif ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
  missing+=(python3-venv)
fi
command -v g++ >/dev/null || missing+=(g++)
if [ ${#missing[@]} -gt 0 ]; then
  echo "Poise needs ${missing[*]} (Python 3.11 or 3.12). Install with:" >&2
  echo "  sudo apt-get update && sudo apt-get install -y ${missing[*]}" >&2
  exit 2
fi

# Runs a command with its output in a log; shows that it goes on, and the log's end when it fails.
log=build/set_up.log
mkdir -p build
step() {
  local what=$1 started=$SECONDS waited=0; shift
  echo "• $what"
  "$@" >>"$log" 2>&1 &
  local job=$!
  while kill -0 "$job" 2>/dev/null; do
    sleep 0.2; waited=$((waited + 1))
    if [ -t 1 ]; then printf '\r  %3d s' $((SECONDS - started)); elif [ $((waited % 50)) -eq 0 ]; then echo "  $((SECONDS - started)) s …"; fi
  done
  [ -t 1 ] && printf '\r         \r'
  if ! wait "$job"; then
    tail -n 30 "$log" >&2
    echo "Failed: $what. The whole log is in $log." >&2
    exit 1
  fi
}

sources() { git ls-files -co --exclude-standard 2>/dev/null || find . -type f -not -path './.venv/*' -not -path './build/*' -not -path './out/*'; }
# Only what the installed package is made of: a changed test or page does not reinstall.
fingerprint=$( { "$python" -V; sources | grep -E '^(\./)?(poise|kernels|nodes|fake_robots|msg_defs|third_party|launch|config|bags|resource)/|^(\./)?(setup\.(py|cfg)|pyproject\.toml|package\.xml|tools/pip_backend\.py)$' \
  | LC_ALL=C sort | while read -r file; do [ -f "$file" ] && sha256sum "$file"; done; } | sha256sum | cut -c1-16)
stamp=$venv/poise-$fingerprint
covered() { [ -f "$stamp" ] && for extra in ${extras//,/ }; do grep -qw "$extra" "$stamp" || return 1; done; }
covered && exit 0

: >"$log"
if ! "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info[:2] not in {(3, 11), (3, 12)})' 2>/dev/null; then
  rm -rf "$venv"
  step "making $venv with $("$python" -V)" "$python" -m venv "$venv"
fi
"$venv/bin/python" -c 'import uv' 2>/dev/null || step "getting uv, a fast installer" "$venv/bin/python" -m pip install --quiet uv
had=$(cat "$venv"/poise-* 2>/dev/null | tr '\n' ' ' || true)
all=$(printf '%s\n' ${extras//,/ } $had | sort -u | paste -sd, -)
rm -rf build/lib*  # setuptools would install modules that are no longer there
step "installing Poise [$all], ROS 2 Jazzy and what they need (the interfaces are compiled once, about 40 s)" \
  env VIRTUAL_ENV="$PWD/$venv" "$venv/bin/python" -m uv pip install --reinstall-package poise ".[$all]"
rm -f "$venv"/poise-*
printf '%s\n' ${all//,/ } >"$stamp"
