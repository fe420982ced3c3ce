#include "bench/report/page_assets.hpp"

namespace meltbench::report {

// Colours 0..7 are the runs; they can be told apart with the common colour vision deficiencies.
const std::string_view kPageStyle = R"css(
:root {
  color-scheme: light dark;
  --page: #ffffff; --panel: #f6f7f8; --line: #dfe2e6; --text: #1d2126; --muted: #626a75; --grid: #e8eaed;
  --good: #1a7f43; --bad: #c0271e; --warn: #b06a00; --good-bg: #e9f6ee; --bad-bg: #fceceb; --link: #1f5fa8;
  --run0: #1f6fb4; --run1: #d1602a; --run2: #23875a; --run3: #8e55b3; --run4: #a67c00; --run5: #1b8fa0; --run6: #c2477f;
  --run7: #6b7280; --below: #1f6fb4; --middle: #f3f3f1; --above: #c0392b;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #15181c; --panel: #1d2126; --line: #343a42; --text: #e4e7eb; --muted: #9aa3ae; --grid: #2a2f36;
    --good: #5cc98a; --bad: #ff8a80; --warn: #f0b352; --good-bg: #16291f; --bad-bg: #321c1b; --link: #7fb6f0;
    --run0: #6cb2f2; --run1: #f08d5a; --run2: #5cc492; --run3: #c795e0; --run4: #e0b84c; --run5: #6fd3e3; --run6: #f083b4;
    --run7: #a3acb9; --below: #6cb2f2; --middle: #22262c; --above: #ff8a70;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 1.5rem clamp(.75rem, 3vw, 2.5rem) 3rem; max-width: 1680px;
  background: var(--page); color: var(--text);
  font: 15px/1.5 system-ui, "Segoe UI", "Liberation Sans", "DejaVu Sans", sans-serif; font-variant-numeric: tabular-nums;
}
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0 0 .75rem; font-weight: 650; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 2.25rem 0 .6rem; font-weight: 650; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; font-weight: 600; overflow-wrap: anywhere; }
p { margin: .4rem 0; max-width: 75ch; }
small, .muted { color: var(--muted); font-size: .87em; }
code, pre { font: .87em/1.5 ui-monospace, "DejaVu Sans Mono", "Liberation Mono", monospace; overflow-wrap: anywhere; }
pre { background: var(--panel); border: 1px solid var(--line); border-radius: 6px; padding: .5rem .75rem; margin: .4rem 0;
      white-space: pre-wrap; }
button { font: inherit; color: inherit; background: none; border: 0; padding: 0; cursor: pointer; }
button:focus-visible, summary:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; border-radius: 3px; }

.banner { border: 1px solid; border-left-width: 6px; border-radius: 6px; padding: .7rem 1rem; margin: 0 0 .5rem; }
.banner b { font-size: 1.15rem; }
.banner.held { color: var(--good); background: var(--good-bg); }
.banner.failed { color: var(--bad); background: var(--bad-bg); }
.banner.odd { color: var(--warn); background: var(--panel); }
.banner span { color: var(--text); }
.verdict { font-weight: 650; white-space: nowrap; }
.held .verdict, .verdict.held { color: var(--good); }
.failed .verdict, .verdict.failed { color: var(--bad); }
.skipped .verdict { color: var(--muted); }
.severity-fault { color: var(--bad); } .severity-warning { color: var(--warn); } .severity-info { color: var(--muted); }

.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid var(--line); }
th { font-weight: 600; color: var(--muted); font-size: .87em; white-space: nowrap; }
th:last-child, td:last-child { padding-right: 0; }
.number { text-align: right; white-space: nowrap; }
td.text { overflow-wrap: anywhere; }
table.checks th:nth-child(1) { width: 7.2em; } table.checks th:nth-child(2) { width: 24%; }
table.checks th:nth-child(3), table.checks th:nth-child(4) { width: 7.5em; }
table.facts { width: auto; } table.facts th { padding-right: 1.5rem; }
.at { color: var(--link); white-space: nowrap; }
.at:hover { text-decoration: underline; }
.failed td { background: color-mix(in srgb, var(--bad-bg) 60%, transparent); }

.swatch { display: inline-block; width: .8em; height: .8em; border-radius: 2px; vertical-align: -.05em; margin-right: .4em;
          background: currentColor; }
.run0 { --run: var(--run0); } .run1 { --run: var(--run1); } .run2 { --run: var(--run2); } .run3 { --run: var(--run3); }
.run4 { --run: var(--run4); } .run5 { --run: var(--run5); } .run6 { --run: var(--run6); } .run7 { --run: var(--run7); }
.swatch { color: var(--run, var(--muted)); }

.bar { position: sticky; top: 0; z-index: 20; background: var(--page); border-bottom: 1px solid var(--line);
       display: flex; flex-wrap: wrap; gap: .25rem 1.1rem; align-items: baseline; padding: .45rem 0; margin-bottom: .75rem; }
.bar .clock { min-width: 8.5em; } .bar .clock:empty { display: none; }
.bar .near { color: var(--muted); flex: 1 1 12em; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.toggle[aria-pressed=false] { opacity: .4; text-decoration: line-through; }
.reset { color: var(--link); }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 560px), 1fr)); gap: 1.25rem 2rem; }
.plots figure:first-child { grid-column: 1 / -1; }
figure { margin: 0; min-width: 0; }
figcaption { display: flex; flex-wrap: wrap; gap: 0 1.1rem; align-items: baseline; min-height: 1.6em; }
figcaption b { font-weight: 600; overflow-wrap: anywhere; }
figcaption .toggle { font-size: .87em; color: var(--muted); text-align: left; overflow-wrap: anywhere; }
figcaption svg { width: 26px; height: 8px; margin-right: .4em; overflow: visible; }
figcaption output { color: var(--text); margin-left: .4em; }
.plot { height: 210px; width: 100%; }
.plots figure:first-child .plot { height: 320px; }
.dygraph-axis-label { color: var(--muted); font-size: 12px; background: none; }

.profiles { margin-bottom: 2rem; }
.profiles .plot { height: 300px; }
.scrub { display: flex; gap: .9rem; align-items: center; margin: .35rem 0 1.25rem; }
.scrub input { flex: 1; min-width: 0; accent-color: var(--link); }
.scrub output { min-width: 8em; text-align: right; }
.play { color: var(--link); min-width: 4.5em; text-align: left; }
.choices { display: flex; flex-wrap: wrap; gap: .3rem 1.1rem; align-items: center; margin-bottom: .4rem; }
.choices b { font-weight: 600; }
.choice { display: inline-flex; border: 1px solid var(--line); border-radius: 6px; overflow: hidden; }
.choice button { padding: .1rem .7rem; font-size: .87em; color: var(--muted); }
.choice button + button { border-left: 1px solid var(--line); }
.choice button[aria-pressed=true] { background: var(--panel); color: var(--text); font-weight: 600; }
.scale { width: 240px; height: 30px; }
.maps { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 380px), 1fr)); gap: .9rem 1.5rem; }
.map { position: relative; height: 230px; overflow: hidden; }
.map canvas { position: absolute; inset: 0; width: 100%; height: 100%; cursor: crosshair; }
.cursor { position: absolute; top: 6px; bottom: 22px; width: 0; border-left: 1px solid #fff; pointer-events: none;
          filter: drop-shadow(0 0 1px #000); }
[hidden] { display: none; }

.filter { display: flex; flex-wrap: wrap; gap: .1rem .9rem; align-items: baseline; margin: .2rem 0; }
.filter b { font-weight: 600; min-width: 4em; }
.search input { font: inherit; color: inherit; background: var(--panel); border: 1px solid var(--line);
                border-radius: 6px; padding: .1rem .5rem; width: min(100%, 18em); }
.story { max-height: 60vh; overflow: auto; border: 1px solid var(--line); border-radius: 6px; padding: 0 .75rem; }
.story thead th { position: sticky; top: 0; background: var(--page); z-index: 1; }
.story td:nth-child(3) { white-space: nowrap; }
.story details { margin: 0; } .story summary { font-weight: inherit; }

.histograms { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 250px), 1fr)); gap: 1.1rem 1.75rem; }
.histograms svg { display: block; width: 100%; height: 80px; border-bottom: 1px solid var(--muted); }
.histograms rect { fill: var(--run); }
.ends { display: flex; justify-content: space-between; color: var(--muted); font-size: .8em; }
details { margin: .5rem 0; } summary { cursor: pointer; font-weight: 600; }
footer { margin-top: 3rem; color: var(--muted); font-size: .87em; }

@media (max-width: 640px) {
  body { font-size: 14px; padding-top: 1rem; }
  .bar .near { flex-basis: 100%; white-space: normal; }
  table.checks, table.checks tbody, table.checks tr, table.checks td { display: block; }
  table.checks thead { display: none; }
  table.checks tr { border-bottom: 1px solid var(--line); padding: .5rem 0; }
  table.checks td { border: 0; padding: 0 .4rem 0 0; text-align: left; }
  table.checks td[data-label]::before { content: attr(data-label) " "; color: var(--muted); }
  table.checks td:nth-child(1), table.checks td:nth-child(2), table.checks td.number { display: inline-block; }
  .failed td { background: none; }
  .story table, .story tbody, .story tr, .story td { display: block; } .story thead { display: none; }
  .story tr[hidden] { display: none; }
  .story tr { border-bottom: 1px solid var(--line); padding: .4rem 0; }
  .story td { border: 0; padding: 0 .5rem 0 0; text-align: left; }
  .story td:nth-child(-n+3) { display: inline-block; }
  table.facts th, table.facts td { padding-right: .6rem; }
  .plots figure:first-child .plot, .profiles .plot { height: 240px; }
  .map { height: 190px; }
}
@media print { .bar { position: static; } .reset, .near { display: none; } figure { break-inside: avoid; } }
)css";

}  // namespace meltbench::report
