#!/bin/sh
# Installs npm packages of exact versions into a folder, once. Usage: npm_packages.sh FOLDER NAME@VERSION...
# Status 77, with the reason: they cannot be had here.
set -eu
folder=$1
shift
command -v npm >/dev/null || { echo "npm is not installed (Debian: nodejs and npm)"; exit 77; }
mkdir -p "$folder"
[ "$(cat "$folder/installed" 2>/dev/null)" = "$*" ] && exit 0
npm install --prefix "$folder" --no-save --no-audit --no-fund --loglevel=error "$@" >"$folder/install.log" 2>&1 ||
  { tail -n 5 "$folder/install.log"; echo "npm cannot install $*"; exit 77; }
echo "$*" >"$folder/installed"
