#include "bench/report/page_assets.hpp"

namespace meltbench::report {

const std::string_view kStoryScript = R"js(
(() => {
  const rows = [...document.querySelectorAll("#story tbody tr")];
  const hidden = { kind: new Set(), node: new Set(), weight: new Set() };
  const search = document.getElementById("story-search");
  const count = document.getElementById("story-count");
  const filter = () => {
    const words = search.value.toLowerCase().split(/\s+/).filter(word => word);
    let shown = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = Object.entries(hidden).some(([what, values]) => values.has(row.dataset[what])) ||
        !words.every(word => text.includes(word));
      if (!row.hidden) ++shown;
    }
    count.textContent = shown === rows.length ? "" : shown + " of " + rows.length + " lines";
  };
  for (const group of document.querySelectorAll(".filter")) {
    const what = group.dataset.of;
    const buttons = [...group.querySelectorAll(".toggle")];
    const values = buttons.map(button => button.dataset.value);
    const show = () => {
      for (const button of buttons) button.setAttribute("aria-pressed", String(!hidden[what].has(button.dataset.value)));
      filter();
    };
    for (const button of buttons) {
      // The first click leaves only this one; further ones add and take away.
      button.addEventListener("click", () => {
        const own = button.dataset.value;
        if (hidden[what].size === 0) hidden[what] = new Set(values.filter(value => value !== own));
        else hidden[what].has(own) ? hidden[what].delete(own) : hidden[what].add(own);
        if (hidden[what].size === values.length) hidden[what].clear();
        show();
      });
    }
    group.querySelector(".reset").addEventListener("click", () => { hidden[what].clear(); show(); });
  }
  search.addEventListener("input", filter);
})();
)js";

}  // namespace meltbench::report
