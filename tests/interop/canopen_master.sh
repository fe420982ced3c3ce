#!/bin/sh
# node-canopen as the master of our six boards, through the tap. Usage, from the root: canopen_master.sh MELTBENCH FOLDER
# FOLDER: where its npm package is installed. Status 77: it cannot be had here.
set -eu
tests/interop/npm_packages.sh "$2" canopen@6.2.1
NODE_PATH="$2/node_modules" exec node tests/interop/canopen_master.js "$1"
