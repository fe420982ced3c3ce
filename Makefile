# make run    builds and runs the main scenarios         make test   runs every test that this machine can run
# make build  builds the three programs                  make bench  measures speeds
# make test-kernel  runs the programs over a real kernel's CAN and serial ports, in small virtual machines
# make record-stories  records the failures of tests/kernel/stories there anew, into fixtures/recordings
BIN := build/release/bin
RUN_OUT := build/run

.PHONY: run test test-kernel record-stories torture build bench bench-realtime asan tsan fuzz deps clean

run: build
	@$(BIN)/meltbench run fixtures/scenarios/delay_compensation.toml --out $(RUN_OUT)
	@$(BIN)/meltbench run fixtures/scenarios/coupled_start_up.toml --out $(RUN_OUT)/coupled_start_up

test: build
	@cmake --build --preset release
	@.ci/test build/release

test-kernel: build
	@tests/kernel/run $(BIN) build/kernel

record-stories: build
	@tests/kernel/record_stories $(BIN) build/stories

build: deps
	@cmake --preset release >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }
	@cmake --build --preset release --target meltbench plant_emulator controller

# Faults by chance; a seed that fails prints the command that repeats it.
torture: build
	@$(BIN)/meltbench torture fixtures/torture/*.toml --seeds 1..10000 --out build/torture

bench: build
	@cmake --build --preset release --target meltbench_benchmarks
	@$(BIN)/meltbench_benchmarks

bench-realtime: build
	@cmake --build --preset release --target meltbench_wakeup_lateness
	@bench/benchmark/realtime/compare.sh $(BIN)

asan tsan: deps
	@cmake --preset $@ >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }
	@cmake --build --preset $@
	@.ci/test build/$@

fuzz: deps
	@.ci/fuzz

deps:
	@mkdir -p build
	@.ci/install_packages

clean:
	rm -rf build
