#pragma once
/// The bizone extruder with true transport: the reading that conserves mass, solved without a grid.

#include <cstddef>

#include "protocols/time/ring.hpp"

namespace meltbench::plant {

/// A point of the material clock: time and conveyed length belong together.
struct ClockPoint {
  double t_s = 0.0;
  double s_m = 0.0;
};

/// Filled length of a bizone extruder whose feed is piecewise constant, by following the material parcel by parcel.
///
/// Label material by y, the conveyed length at which it entered. Where it reaches the filled zone, x = P(y), with
///
///   dP/dy = U(y) - theta2 (1 - U(y)) P                                                                  (D8)
///   it arrives at   s = y + L - P(y),   ds/dy = (1 - U)(1 + theta2 P) > 0                               (D9)
///
/// Within a parcel U is constant, so (D8) has a closed form (D10) and only the scalar (D9) is solved for y.
/// No step size, no grid, no smearing of the feed front: exact but for rounding, about 1e-15 m per step.
///
/// At P = L the partially filled zone is gone (flooded): x stays L, and feed that the nozzle does not take is spilled.
/// Real time: no heap after construction. A step costs one closed form per parcel consumed, one on average.
class ParcelPlant {
 public:
  /// @param U_before  filling ratio of all material that entered before the start.
  /// @param max_parcels  parcels between inlet and filled zone. If there are more, the newest two are merged at equal
  ///                     mass: the resolution of the feed suffers, mass does not. See merged_parcels().
  ParcelPlant(double length_m, double theta2_per_m, double x0_m, double U_before, std::size_t max_parcels = 32768);

  /// Conveys up to `to` with inlet filling ratio U held.
  /// @pre to.s_m >= the previous one (equal: nothing moves, nothing enters); 0 <= U <= kMaxFillRatio.
  void advance(ClockPoint to, double U);
  /// From now on. (D8) is of first order in y, so a new theta2 goes on from the x that has been reached. @pre > 0.
  void set_theta2_per_m(double theta2_per_m) { theta2_ = theta2_per_m; }

  [[nodiscard]] double x_m() const { return x_; }
  /// Filling ratio of the material that now reaches the filled zone.
  [[nodiscard]] double U_at_interface() const { return arriving_parcel().U; }
  [[nodiscard]] bool flooded() const { return flooded_; }

  /// Entry coordinate y of the material now arriving [m]: the conveyed length when it entered.
  [[nodiscard]] double arriving_y_m() const { return y_; }

  /// Material that entered with one filling ratio. What entered before the start begins at minus infinity.
  struct Parcel {
    ClockPoint begin, end;
    double U = 0.0;
  };
  /// The parcel that arriving_y_m() lies in, to find out when it entered.
  [[nodiscard]] const Parcel& arriving_parcel() const { return parcels_.empty() ? last_ : parcels_.front(); }

  /// All material in the barrel, as metres of full channel: x + int_x^L u dz.
  [[nodiscard]] double content_m() const { return x_ + in_transit_m_; }
  /// The same, summed anew over all parcels. Costs O(parcels): for tests.
  [[nodiscard]] double calc_content_m() const;
  [[nodiscard]] double inflow_m() const { return inflow_m_; }  ///< int U ds since the start.
  [[nodiscard]] double outflow_m() const {
    return outflow_m_;
  }                                                          ///< int v(x) ds since the start, by quadrature of (D11).
  [[nodiscard]] double spill_m() const { return spill_m_; }  ///< Refused because flooded.
  /// Content minus what the flows say it should be, (D12). Shows a fault of the solver; rounding keeps it < 1e-8 m.
  [[nodiscard]] double mass_residual_m() const {
    return content_m() - content0_m_ - (inflow_m_ - outflow_m_ - spill_m_);
  }
  [[nodiscard]] std::size_t merged_parcels() const { return merged_parcels_; }

 private:
  [[nodiscard]] double calc_P(double P0, double d, double U) const;
  [[nodiscard]] double calc_arrival_distance(double rest, double d_max, double U) const;
  void append(ClockPoint to, double U);
  void consume();
  void convey(double d, double P_end, double U);
  void flood(const Parcel& parcel);

  double L_, theta2_;
  Ring<Parcel> parcels_;  // From the one now arriving to the one at the inlet.
  Parcel last_;           // The newest, even if it has arrived already.
  ClockPoint now_;
  double x_, y_;  // Filled length; entry coordinate of the material that arrives now.
  bool flooded_ = false;
  double in_transit_m_, content0_m_;
  double inflow_m_ = 0.0, outflow_m_ = 0.0, spill_m_ = 0.0;
  std::size_t merged_parcels_ = 0;
};

}  // namespace meltbench::plant
