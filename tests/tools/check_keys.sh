#!/bin/sh
# Checks that each key that rig and scenario readers ask for is explained: in a rig file, or in the texts beside the
# scenarios. Prints those that are not. Run from the root of the repository.
set -eu
readers='number|integer|duration|boolean|text|texts|numbers|choice|path|section|sections|has'
keys=$(grep -rhoE "[.>]($readers)(_or|_or_none|_or_empty)?(<[A-Za-z:]*>)?\(\"[A-Za-z0-9_]+\"" \
           protocols/config protocols/fault controller plant_emulator bench --include='*.cpp' |
       sed 's/.*("//; s/"$//' | sort -u)
[ "$(echo "$keys" | wc -l)" -gt 100 ] || { echo "error: found hardly any key: has the readers' look changed?"; exit 1; }
bad=0
for key in $keys; do
  [ "$key" = variant_title ] && continue  # Of repro.toml, which the bench writes for itself.
  grep -qw -- "$key" fixtures/rigs/*.toml fixtures/scenarios/*.md && continue
  echo "$key is read, and explained nowhere"
  bad=1
done
[ $bad -eq 0 ] && echo "every key that is read is explained"
exit $bad
