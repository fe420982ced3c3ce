#include "bench/record/bus_timing.hpp"

#include <array>
#include <nlohmann/json.hpp>
#include <utility>

namespace meltbench::record {
namespace {

using Json = nlohmann::json;
using Out = nlohmann::ordered_json;
using Count = std::pair<const char*, std::uint64_t NodeTiming::*>;

constexpr std::array<Count, 13> kCounts{{{"tec", &NodeTiming::tec},
                                         {"rec", &NodeTiming::rec},
                                         {"tx_packets", &NodeTiming::tx_packets},
                                         {"tx_bytes", &NodeTiming::tx_bytes},
                                         {"tx_dropped", &NodeTiming::tx_dropped},
                                         {"rx_packets", &NodeTiming::rx_packets},
                                         {"rx_bytes", &NodeTiming::rx_bytes},
                                         {"bus_errors", &NodeTiming::bus_errors},
                                         {"arbit_lost", &NodeTiming::arbit_lost},
                                         {"error_warn", &NodeTiming::error_warn},
                                         {"error_pass", &NodeTiming::error_pass},
                                         {"bus_off", &NodeTiming::bus_off},
                                         {"re_started", &NodeTiming::re_started}}};

}  // namespace

void to_json(Out& json, const BusTiming& timing) {
  Out responses = Out::array();
  for (const ResponseTiming& r : timing.responses) {
    responses.push_back(Out{{"cob_id", r.id},
                            {"extended", r.extended},
                            {"node", r.node},
                            {"frames", r.frames},
                            {"mean_delay_s", r.mean_delay_s},
                            {"worst_delay_s", r.worst_delay_s},
                            {"worst_response_s", r.worst_response_s},
                            {"bound_s", r.bound_s ? Out(*r.bound_s) : Out(nullptr)}});
  }
  Out nodes = Out::array();
  for (const NodeTiming& n : timing.nodes) {
    Out node{{"name", n.name}, {"state", n.state}};
    for (const auto& [name, count] : kCounts) node[name] = n.*count;
    nodes.push_back(std::move(node));
  }
  json = Out{{"load", timing.load}, {"responses", std::move(responses)}, {"nodes", std::move(nodes)}};
}

void from_json(const Json& json, BusTiming& timing) {
  json.at("load").get_to(timing.load);
  for (const Json& object : json.at("responses")) {
    ResponseTiming r;
    object.at("cob_id").get_to(r.id);
    object.at("extended").get_to(r.extended);
    object.at("node").get_to(r.node);
    object.at("frames").get_to(r.frames);
    object.at("mean_delay_s").get_to(r.mean_delay_s);
    object.at("worst_delay_s").get_to(r.worst_delay_s);
    object.at("worst_response_s").get_to(r.worst_response_s);
    if (const Json& bound = object.at("bound_s"); !bound.is_null()) r.bound_s = bound.get<double>();
    timing.responses.push_back(std::move(r));
  }
  for (const Json& object : json.at("nodes")) {
    NodeTiming n;
    object.at("name").get_to(n.name);
    object.at("state").get_to(n.state);
    for (const auto& [name, count] : kCounts) object.at(name).get_to(n.*count);
    timing.nodes.push_back(std::move(n));
  }
}

}  // namespace meltbench::record
