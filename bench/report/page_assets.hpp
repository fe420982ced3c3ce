#pragma once
/// The fixed parts of the page.

#include <string_view>

namespace meltbench::report {

extern const std::string_view kPageStyle;   ///< CSS.
extern const std::string_view kPageScript;  ///< JavaScript; needs dygraphs, its synchronizer, and the element #data.
/// JavaScript after kPageScript; fills the element #profiles.
extern const std::string_view kProfileScript;
/// JavaScript for the filters of the table #story.
extern const std::string_view kStoryScript;

}  // namespace meltbench::report
