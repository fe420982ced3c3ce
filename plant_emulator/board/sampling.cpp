#include "plant_emulator/board/sampling.hpp"

namespace meltbench::board {

namespace {

/// FNV-1a: std::hash may differ between libraries.
std::uint64_t hash_of(std::string_view text) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
  return hash;
}

/// SplitMix64's finisher: a bijection that spreads neighbouring inputs over all 64 bits.
std::uint64_t mix(std::uint64_t x) {
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31U);
}

double to_unit(std::uint64_t bits) {
  return static_cast<double>(bits >> 11U) * 0x1p-53;
}

}  // namespace

Chance::Chance(std::uint64_t seed, std::string_view name) : engine_{mix(seed) ^ hash_of(name)} {}

double Chance::draw_uniform() {
  return to_unit(engine_());
}

Nanos Chance::draw_phase(Nanos period) {
  constexpr Nanos kStep = 10us;
  return static_cast<std::int64_t>(draw_uniform() * static_cast<double>(period / kStep)) * kStep;
}

double calc_noise(std::uint64_t seed, std::int64_t sample_number) {
  double sum = -6.0;
  std::uint64_t state = mix(seed ^ mix(static_cast<std::uint64_t>(sample_number)));
  for (int i = 0; i < 12; ++i) {
    state += 0x9e3779b97f4a7c15U;
    sum += to_unit(mix(state));
  }
  return sum;  // Variance of one uniform number is 1/12, so that of the sum is 1.
}

double draw_at(std::uint64_t seed, std::int64_t number) {
  return to_unit(mix(seed ^ mix(static_cast<std::uint64_t>(number))));
}

Instant SampleClock::first_from(Instant at) const {
  if (period_ == 0ns) return at;
  const Nanos since = at.since_start - phase_;
  if (since <= 0ns) return Instant{phase_};
  const std::int64_t k = (since + period_ - 1ns) / period_;
  return Instant{phase_ + k * period_};
}

Instant SampleClock::last_until(Instant at) const {
  if (period_ == 0ns) return at;
  const Nanos since = at.since_start - phase_;
  if (since < 0ns) return kNone;
  return Instant{phase_ + (since / period_) * period_};
}

std::int64_t SampleClock::number_of(Instant sample) const {
  return period_ == 0ns ? sample.since_start.count() : (sample.since_start - phase_) / period_;
}

}  // namespace meltbench::board
