"""The page's looks: light and dark as the reader's system has it, one column on a telephone."""

CSS = """
:root { color-scheme: light dark; --ink: #1d1d24; --soft: #62626e; --paper: #fcfcfd; --card: #fff; --line: #dcdce4;
  --accent: #b06f00; --uplink: #d55e00; --downlink: #9a5fb0; --sidelink: #009e73; }
@media (prefers-color-scheme: dark) { :root { --ink: #e9e9ee; --soft: #a0a0ad; --paper: #16161b; --card: #1e1e25;
  --line: #383844; --accent: #f0b040; --uplink: #ff8a3d; --downlink: #c39bd3; --sidelink: #2fc79a; } }
body { margin: 0; background: var(--paper); color: var(--ink); font: 15px/1.5 system-ui, sans-serif; }
.nicegui-content { padding: 0; display: block; width: 100%; }
main { max-width: 78rem; margin: 0 auto; padding: 1rem 1rem 3rem; }
h1 { font-size: 1.35rem; line-height: 1.3; font-weight: 650; margin: 0; }
h2 { font-size: .95rem; line-height: 1.3; font-weight: 650; margin: 0 0 .5rem; }
p { margin: 0; } .soft { color: var(--soft); font-size: .85rem; }
.head { display: flex; flex-wrap: wrap; gap: .2rem 1rem; align-items: baseline; margin-bottom: .3rem; }
.status { font-weight: 600; } .status.running, .status.listening, .status.starting { color: var(--accent); }
.status.complete { color: var(--sidelink); } .status.failed, .status.interrupted { color: var(--uplink); }
.answer { border-left: 4px solid var(--accent); padding: .1rem .9rem; margin: .5rem 0 .8rem; }
.answer b { font-size: 1.15rem; font-weight: 650; }
.answer summary { color: var(--soft); cursor: pointer; display: list-item; list-style: inside disclosure-closed; }
.answer [open] summary { list-style-type: disclosure-open; }
.answer dl { display: grid; grid-template-columns: max-content minmax(0, 1fr); gap: 0 .9rem; margin: .15rem 0; }
.answer dt { color: var(--soft); } .answer dd { margin: 0; }
.arms { display: grid; grid-template-columns: repeat(auto-fit, minmax(13rem, 1fr)); gap: .7rem; margin-bottom: .7rem; }
.arm { border-left: 5px solid; padding: .35rem .8rem; background: var(--card); border-radius: 4px; }
.arm b { font-size: 1.5rem; font-weight: 650; font-variant-numeric: tabular-nums; display: block; line-height: 1.25; }
.columns { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: .7rem; }
.tasks { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr)); gap: .7rem; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: .7rem .9rem;
  min-width: 0; }
.wide { margin-top: .7rem; }
@media (max-width: 760px) { .columns { grid-template-columns: minmax(0, 1fr); } main { padding: .7rem .6rem 2rem; } }
svg.deployment { width: 100%; max-height: 26rem; display: block; }
svg text { fill: var(--ink); font: 13px system-ui, sans-serif; text-anchor: middle; }
@media (max-width: 760px) { svg.deployment text { font-size: 16px; } }
svg text.soft { fill: var(--soft); } svg text.left { text-anchor: start; } svg .strong { font-weight: 650; }
svg .node { fill: var(--card); stroke: var(--soft); stroke-width: 1.4; }
svg .cluster { fill: none; stroke: var(--line); stroke-width: 1.4; } svg text.robot { font-size: 11px; }
svg .link { stroke-linecap: round; opacity: .8; transition: stroke-width .4s; }
svg .uplink { stroke: var(--uplink); } svg .downlink { stroke: var(--downlink); }
svg .sidelink { stroke: var(--sidelink); } svg .control { stroke: var(--soft); } svg .other { stroke: var(--line); }
svg.meter text { font-size: 14px; } @media (max-width: 760px) { svg.meter text { font-size: 18px; } }
.table { overflow-x: auto; } .table table { border-collapse: collapse; width: 100%; font-size: .88rem; }
.table th { color: var(--soft); font-weight: 400; text-align: left; }
.table th, .table td { padding: .15rem .6rem .15rem 0; border-bottom: 1px solid var(--line); white-space: nowrap; }
.table td { max-width: 18rem; overflow: hidden; text-overflow: ellipsis; }
@media (max-width: 760px) { .table td { max-width: 8.5rem; } }
.table :is(td, th):last-child { padding-left: .8rem; }
.table :is(td, th).figure { text-align: right; font-variant-numeric: tabular-nums; }
svg.map { max-width: 100%; height: auto; margin: .2rem auto 0; display: block; } svg.map text { fill: var(--soft); }
svg .floor { fill: var(--line); opacity: .45; } svg .path { fill: var(--soft); opacity: .35; }
svg .obstacle { fill: var(--ink); opacity: .75; } svg .walker { stroke: var(--card); stroke-width: 1.5; }
.slider { display: grid; grid-template-columns: 1fr auto; align-items: baseline; gap: 0 .6rem; margin-bottom: .25rem; }
.slider .q-slider { grid-column: 1 / -1; margin: -.2rem .5rem 0; width: calc(100% - 1rem); }
.slider .value { font-variant-numeric: tabular-nums; font-weight: 600; }
.sliders { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(15rem, 100%), 1fr)); gap: 0 1.4rem; }
.events { margin: 0; padding: 0; list-style: none; max-height: 14rem; overflow-y: auto; font-size: .88rem; }
.events li { overflow-wrap: anywhere; } .events time { color: var(--soft); margin-right: .6rem; }
code { font-size: .8rem; overflow-wrap: anywhere; }
"""
