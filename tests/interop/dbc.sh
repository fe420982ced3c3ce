#!/bin/sh
# node-candied decodes frames by a DBC as we do. Usage, from the root: dbc.sh MELTBENCH FOLDER
# FOLDER: where its npm package is installed. Status 77: it cannot be had here.
set -eu
tests/interop/npm_packages.sh "$2" candied@2.2.0
NODE_PATH="$2/node_modules" exec node tests/interop/dbc.js "$1"
