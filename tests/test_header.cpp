// Only carries the precompiled header of all tests.
