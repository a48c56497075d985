"""How the page looks: one column of text, figures as wide as they need, light or dark."""

STYLE = """
:root{color-scheme:light dark;--paper:#fbfbfa;--card:#fff;--ink:#1c2430;--soft:#5d6877;
--line:#e1e4e8;--good:#1b7f4b;--bad:#c0271d;--mid:#8a6100;--c0:#0a6ebd;--c1:#d1590b;--c2:#2a8c5a;
--c3:#8a4fbf;--c4:#b8860b;--c5:#c03a72}
@media (prefers-color-scheme:dark){:root{--paper:#14181d;--card:#1b2027;--ink:#e4e8ee;
--soft:#98a3b1;--line:#2e353f;--good:#5cc890;--bad:#ff8077;--mid:#e0b04c;--c0:#5cb3f5;--c1:#ff9a57;
--c2:#62c894;--c3:#bd92ea;--c4:#dcb145;--c5:#f07cab}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);
font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","DejaVu Sans",sans-serif}
main{max-width:1180px;margin:0 auto;padding:2.5rem 1.5rem 5rem}
h1{font-size:2rem;line-height:1.15;margin:0 0 .6rem;letter-spacing:-.015em;text-wrap:balance}
h2{font-size:1.35rem;margin:3.4rem 0 .9rem;letter-spacing:-.01em}
h3{font-size:1.05rem;margin:0;line-height:1.35}
p{margin:.4rem 0;max-width:46rem}
.lead{font-size:1.06rem;color:var(--soft)}
.soft{color:var(--soft)}
a{color:var(--c0);text-decoration-thickness:1px;text-underline-offset:2px}
.tiles{display:flex;flex-wrap:wrap;gap:.8rem;margin:1.6rem 0 1rem}
.tile{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:.7rem 1.1rem;
min-width:9rem;flex:0 1 auto}
.tile b{display:block;font-size:1.65rem;line-height:1.2;font-variant-numeric:tabular-nums}
.tile span{color:var(--soft);font-size:.86rem}
nav ul{list-style:none;padding:0;margin:1.2rem 0;display:grid;
grid-template-columns:repeat(auto-fill,minmax(19rem,1fr));gap:.15rem 1.6rem}
nav li{display:flex;justify-content:space-between;gap:1rem;border-bottom:1px solid var(--line);
padding:.3rem 0}
nav .count{color:var(--soft);font-variant-numeric:tabular-nums;white-space:nowrap}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;
padding:1.2rem 1.3rem 1rem;margin:1.1rem 0}
.card header{display:flex;gap:.2rem 1rem;justify-content:space-between;align-items:baseline;
flex-wrap:wrap}
.card .of{color:var(--soft);font-size:.88rem}
.panels{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(24rem,100%),1fr));
gap:.6rem 1.4rem;margin:1rem 0 .6rem;justify-items:center}
.panels svg{width:100%;max-width:34rem;height:auto;display:block;color:var(--ink)}
.panels svg text{font-family:inherit}
.three .panels{grid-template-columns:repeat(auto-fit,minmax(min(17rem,100%),1fr))}
.caption{font-size:.92rem;color:var(--soft);max-width:60rem;margin-bottom:.8rem}
table{border-collapse:collapse;width:100%;font-size:.9rem;font-variant-numeric:tabular-nums}
th{font-weight:600;text-align:left;color:var(--soft);font-size:.8rem;
border-bottom:1px solid var(--line);padding:.35rem .6rem;white-space:nowrap}
td{padding:.5rem .6rem;border-bottom:1px solid var(--line);vertical-align:top}
tr:last-child td{border-bottom:0}
td.n,th.n{text-align:right;white-space:nowrap}
td.what{min-width:13rem}
td .why{display:block;color:var(--soft);font-size:.82rem;line-height:1.4;max-width:34rem}
td .src{color:var(--soft);font-size:.82rem}
.unit{color:var(--soft)}
.badge{white-space:nowrap;font-weight:600;font-size:.84rem}
.pass{color:var(--good)}.fail{color:var(--bad)}.cmp{color:var(--mid)}
.printed{color:var(--bad)}
sup,sub{line-height:0;font-size:.74em}
code{font-size:.86em;color:var(--soft);overflow-wrap:anywhere}
footer{margin-top:3.5rem;color:var(--soft);font-size:.86rem}
@media (max-width:760px){
main{padding:1.6rem 1rem 3rem}h1{font-size:1.55rem}
.card{padding:1rem .9rem .8rem}
table,tbody,tr,td{display:block}thead{display:none}
tr{border-bottom:1px solid var(--line);padding:.7rem 0;display:grid;
grid-template-columns:1fr 1fr;column-gap:1rem}tr:last-child{border-bottom:0}
td.what{grid-column:1/-1;padding-bottom:.3rem}
td,td.n{border:0;padding:.1rem 0;text-align:left;white-space:normal}
td[data-l]::before{content:attr(data-l);color:var(--soft);display:block;font-size:.76rem;
line-height:1.2;padding-top:.25rem}
td.what{font-size:.95rem}
.tile{flex:1 1 28%;min-width:0;padding:.6rem .7rem}.tile b{font-size:1.15rem}
.tile span{font-size:.78rem;display:block;line-height:1.35}
}
@media print{body{background:#fff}.card{break-inside:avoid}}
"""
"""Of the page."""
