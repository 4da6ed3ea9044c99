"""The style sheet of the report's page, for light and dark screens and for print."""

#: CSS, as it stands in the page's head.
STYLE = """
:root{color-scheme:light dark;--page:#f6f6f4;--card:#fff;--ink:#1e2023;--soft:#6b7076;
--line:#e2e2de;--accent:#2b6cb0;--warm:#d9822b;--good:#2f855a;--bad:#c0392b;
--zone:#2b6cb014}
@media (prefers-color-scheme:dark){:root{--page:#17181a;--card:#222427;--ink:#e9e9e6;
--soft:#a0a4a9;--line:#37393d;--accent:#6cb2f5;--warm:#f0a355;--good:#6fcf97;
--bad:#f08577;--zone:#6cb2f51f}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--ink);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
main{max-width:1180px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:30px;line-height:1.2;margin:0 0 4px}
h2{font-size:19px;margin:38px 0 12px}
p.lead,.soft{color:var(--soft)}p.lead{margin:0 0 20px}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;
padding:16px}
.facts{display:flex;flex-wrap:wrap;gap:12px;margin:0 0 18px;padding:0}
.facts div{background:var(--card);border:1px solid var(--line);border-radius:10px;
padding:10px 16px;min-width:132px}
.facts b{display:block;font-size:22px;line-height:1.25}.facts span{color:var(--soft)}
.grid{display:grid;gap:14px;grid-template-columns:repeat(auto-fill,minmax(330px,1fr))}
.photos{display:grid;gap:12px;grid-template-columns:repeat(auto-fill,minmax(196px,1fr))}
.photos .card{padding:8px;overflow:hidden;position:relative}
.photos img{width:100%;aspect-ratio:1;object-fit:cover;border-radius:6px;display:block;
background:var(--line)}
.photos img+img{position:absolute;top:12px;right:12px;width:34%;
border:1px solid var(--card)}
.photos .none{aspect-ratio:1;border-radius:6px;display:grid;place-items:center;
background:var(--line);color:var(--soft);text-align:center;padding:14px}
.photos strong{display:block;margin-top:6px;overflow:hidden;text-overflow:ellipsis;
white-space:nowrap}
.photos small{display:block;color:var(--soft);font-size:12.5px;line-height:1.4}
.badge{float:right;font-size:12px;border-radius:20px;padding:0 9px;margin-left:6px;
color:#fff;background:var(--good)}.badge.bad{background:var(--bad)}
.views{background:#fff;text-align:center;padding:10px}
.views img{max-width:100%;height:auto;display:block;margin:0 auto}
.maps{display:grid;gap:14px;grid-template-columns:repeat(auto-fill,minmax(172px,1fr))}
.maps.wide{grid-template-columns:repeat(auto-fill,minmax(340px,1fr))}
figure{margin:0}figure img{width:100%;display:block;border-radius:6px}
figcaption{color:var(--soft);font-size:13px;margin-top:5px}
.plot svg{width:100%;height:auto;display:block}.plot h3{margin:0 0 6px;font-size:15px}
.plot p{margin:6px 0 0;font-size:13px;color:var(--soft)}
svg text{font-size:11px;fill:var(--soft)}svg .label{fill:var(--ink)}
svg .grid{stroke:var(--line);stroke-width:1}svg .dot{fill:var(--accent);
fill-opacity:.8}svg .light{fill:var(--warm);fill-opacity:.75}
svg .disc{fill:var(--zone);stroke:var(--line)}svg .ring{fill:none;stroke:var(--line)}
svg .zone{fill:var(--zone)}svg .zone.empty{fill:none;stroke:var(--bad);
stroke-dasharray:4 4;stroke-opacity:.6}svg .bar{fill:var(--accent)}
svg .bar.weak{fill:var(--soft);fill-opacity:.45}
svg .line{fill:none;stroke:var(--accent);stroke-width:1.6}
.next{margin:0;padding-left:20px}.next li{margin:3px 0}
.scale{display:flex;align-items:center;gap:8px;font-size:13px;color:var(--soft);
justify-content:center;margin-top:6px}
.scale i{width:180px;height:10px;border-radius:5px;display:block}
table{border-collapse:collapse;width:100%;font-size:13.5px}
td,th{padding:3px 10px 3px 0;text-align:left;vertical-align:top;
border-bottom:1px solid var(--line)}th{font-weight:600}
.key i{display:inline-block;width:10px;height:10px;border-radius:5px;
margin:0 4px 0 12px}
@media print{.card,.facts div{break-inside:avoid}}
"""
