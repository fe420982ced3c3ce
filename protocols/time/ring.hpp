#pragma once
/// A queue in one piece of memory that never grows.

#include <bit>
#include <cstddef>
#include <vector>

namespace meltbench {

/// First in, first out; capacity fixed at construction (rounded up to a power of two), no allocation afterwards.
/// Index 0 is the oldest element.
template <typename T>
class Ring {
 public:
  explicit Ring(std::size_t capacity) : items_(std::bit_ceil(capacity)), mask_{items_.size() - 1} {}

  [[nodiscard]] std::size_t size() const { return end_ - begin_; }
  [[nodiscard]] bool empty() const { return begin_ == end_; }
  [[nodiscard]] bool full() const { return size() == items_.size(); }
  [[nodiscard]] const T& operator[](std::size_t i) const { return items_[(begin_ + i) & mask_]; }
  [[nodiscard]] const T& front() const { return items_[begin_ & mask_]; }
  [[nodiscard]] T& back() { return items_[(end_ - 1) & mask_]; }
  [[nodiscard]] const T& back() const { return items_[(end_ - 1) & mask_]; }

  /// @pre !full().
  void push_back(const T& item) { items_[end_++ & mask_] = item; }
  void clear() { begin_ = end_ = 0; }
  /// @pre !empty().
  void pop_front() { ++begin_; }

 private:
  std::vector<T> items_;
  std::size_t mask_;
  std::size_t begin_ = 0, end_ = 0;  // Count up for ever; the mask folds them.
};

}  // namespace meltbench
