#include "protocols/participant/restartable.hpp"

#include <algorithm>
#include <utility>

namespace meltbench {

Restartable::Restartable(Make make)
    : make_{std::move(make)},
      program_{make_()},
      name_{program_->name()},
      nodes_{program_->nodes().begin(), program_->nodes().end()},
      lines_{program_->lines().begin(), program_->lines().end()},
      signals_{program_->signals().begin(), program_->signals().end()} {}

void Restartable::wake(const Wakeup& in, Outbox& out) {
  if (std::find(in.orders.begin(), in.orders.end(), kOrder) != in.orders.end()) program_ = make_();
  program_->wake(in, out);
}

}  // namespace meltbench
