# SPDX-License-Identifier: MIT
"""The parts that an HTML report is put together from: the page around it, tables and figures; everything is escaped."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

_STYLE = """
:root{color-scheme:light dark;--page:#fff;--ink:#1d2129;--soft:#5b6470;--line:#d9dee5;--card:#f5f7f9;--warn:#8a4b00;--warnbg:#fff4e0;
--c0:#0072b2;--c1:#d55e00;--c2:#009e73;--c3:#cc79a7;--c4:#e69f00;--c5:#56b4e9}
@media(prefers-color-scheme:dark){:root{--page:#14171b;--ink:#e4e8ed;--soft:#9aa4b0;--line:#333a43;--card:#1d2127;--warn:#ffc46b;--warnbg:#33270f;
--c0:#4aa8e0;--c1:#ff8a47;--c2:#35c79b;--c3:#e19bc4;--c4:#f0b429;--c5:#8fd0f5}}
*{box-sizing:border-box}
body{margin:0 auto;max-width:62rem;padding:1.2rem;background:var(--page);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
h1{font-size:1.5rem;margin:0 0 .1rem;overflow-wrap:anywhere}h2{font-size:1.1rem;margin:2.2rem 0 .6rem;border-bottom:1px solid var(--line);padding-bottom:.2rem}
h3{font-size:.95rem;margin:1.2rem 0 .1rem}p{margin:.2rem 0 .6rem}.soft,figcaption{color:var(--soft);font-size:.87rem}
.cards{display:grid;grid-template-columns:repeat(auto-fill,minmax(10.5rem,1fr));gap:.6rem;margin:1rem 0}
.card{background:var(--card);border-radius:8px;padding:.55rem .75rem}.card b{display:block;font-size:1.2rem;font-weight:600;overflow-wrap:anywhere}
.card span{color:var(--soft);font-size:.82rem}.card.warn b{color:var(--warn)}
.warnings{background:var(--warnbg);color:var(--warn);border-radius:8px;padding:.6rem 1rem .6rem 2rem;margin:.6rem 0}
ul{padding-left:1.2rem;margin:.4rem 0}li{overflow-wrap:anywhere}
figure{margin:.8rem 0}svg{display:block;width:100%;height:auto}.scroll{overflow-x:auto}
table{border-collapse:collapse;min-width:min(100%,28rem);font-size:.87rem}th,td{text-align:left;padding:.22rem .8rem .22rem 0;border-bottom:1px solid var(--line);vertical-align:top}
th{color:var(--soft);font-weight:500}td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}td{overflow-wrap:break-word;max-width:44rem}td:last-child{overflow-wrap:anywhere}
tr.changed td{font-weight:600}.bar{background:var(--c0);height:.7rem;border-radius:2px;min-width:1px;print-color-adjust:exact;-webkit-print-color-adjust:exact}td.wide{width:55%;min-width:8rem;vertical-align:middle}
code,pre{font:13px/1.5 ui-monospace,monospace}pre{background:var(--card);padding:.7rem;border-radius:8px;white-space:pre-wrap;overflow-wrap:anywhere}
.line{fill:none;stroke-width:1.3;vector-effect:non-scaling-stroke;stroke-linejoin:round;stroke-linecap:round}.axis{stroke:var(--soft);fill:none}.grid{stroke:var(--line);fill:none}
.tick{font-size:11px;fill:var(--soft)}.label{font-size:12px;fill:var(--soft)}.mark{stroke:var(--soft);stroke-width:1}
.c0{stroke:var(--c0)}.c1{stroke:var(--c1)}.c2{stroke:var(--c2)}.c3{stroke:var(--c3)}.c4{stroke:var(--c4)}.c5{stroke:var(--c5)}
.map{position:relative;overflow:hidden;background:#fff;border:1px solid var(--line);border-radius:8px;touch-action:pan-y}
.map img{display:block;max-width:100%;max-height:90vh;margin:auto;transform-origin:0 0}.map.zoomed{touch-action:none;cursor:grab}.map.zoomed img{image-rendering:pixelated}
.tools{position:absolute;top:.5rem;right:.5rem;display:none;gap:.3rem}.js .tools{display:flex}
.tools button{font:16px/1 system-ui,sans-serif;min-width:2.2rem;height:2.2rem;border:1px solid #c5ccd5;border-radius:6px;background:#ffffffe0;color:#1d2129;cursor:pointer}
@media(max-width:600px){body{padding:.8rem}.tick{font-size:15px}.label{font-size:16px}}
@media print{body{max-width:none;padding:0;font-size:11px}.tools,.js .tools{display:none}figure,.cards,tr{break-inside:avoid}h2,h3{break-after:avoid}.map{border:0}
:root{--page:#fff;--ink:#000;--soft:#444;--line:#bbb;--card:#fff;--warn:#000;--warnbg:#fff;--c0:#0072b2;--c1:#d55e00;--c2:#009e73;--c3:#cc79a7;--c4:#e69f00;--c5:#56b4e9}}
"""

# Zooms the map by wheel (with Ctrl or when zoomed), two fingers, buttons and double click; without it the map is a plain image.
_SCRIPT = """
(function(){document.documentElement.classList.add('js');
document.querySelectorAll('.map').forEach(function(box){var img=box.querySelector('img'),k=1,x=0,y=0,held=new Map(),gap=0;
function show(){var w=img.offsetWidth,h=img.offsetHeight;if(k<=1){k=1;x=y=0}x=Math.min(0,Math.max(w-w*k,x));y=Math.min(0,Math.max(h-h*k,y));
img.style.transform='translate('+x+'px,'+y+'px) scale('+k+')';box.classList.toggle('zoomed',k>1)}
function zoom(f,cx,cy){var n=Math.min(40,Math.max(1,k*f));f=n/k;x=cx-(cx-x)*f;y=cy-(cy-y)*f;k=n;show()}
function at(e){var r=box.getBoundingClientRect();return[e.clientX-r.left-img.offsetLeft,e.clientY-r.top-img.offsetTop]}
box.addEventListener('wheel',function(e){if(!e.ctrlKey&&k===1&&e.deltaY>0)return;if(!e.ctrlKey&&!box.matches(':focus-within')&&k===1)return;
e.preventDefault();var p=at(e);zoom(Math.exp(-e.deltaY*.002),p[0],p[1])},{passive:false});
box.addEventListener('dblclick',function(e){if(e.target!==img)return;var p=at(e);k>1?(k=1,show()):zoom(4,p[0],p[1])});
box.addEventListener('pointerdown',function(e){if(e.target!==img)return;held.set(e.pointerId,at(e));gap=0;if(k>1)box.setPointerCapture(e.pointerId)});
box.addEventListener('pointermove',function(e){var o=held.get(e.pointerId);if(!o)return;var p=at(e);held.set(e.pointerId,p);
if(held.size===2){var q=Array.from(held.values()),d=Math.hypot(q[0][0]-q[1][0],q[0][1]-q[1][1]);
if(gap)zoom(d/gap,(q[0][0]+q[1][0])/2,(q[0][1]+q[1][1])/2);gap=d}else if(k>1){x+=p[0]-o[0];y+=p[1]-o[1];show()}});
['pointerup','pointercancel','pointerleave'].forEach(function(n){box.addEventListener(n,function(e){held.delete(e.pointerId);gap=0})});
box.querySelectorAll('button').forEach(function(b){b.addEventListener('click',function(){var f=+b.dataset.zoom;
if(!f){k=1;show()}else zoom(f,img.offsetWidth/2,img.offsetHeight/2)})});
img.draggable=false;})})();
"""


def document(title: str, body: Iterable[str]) -> str:
    """Return a whole page that loads nothing from anywhere (its own policy forbids it)."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none';img-src data:;style-src 'unsafe-inline';"
        "script-src 'unsafe-inline'\">"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body>\n"
        + "\n".join(part for part in body if part)
        + f"\n<script>{_SCRIPT}</script>\n</body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """Return a section, or nothing if it has no content."""
    content = "\n".join(part for part in parts if part)
    return f"<section><h2>{escape(title)}</h2>\n{content}</section>" if content else ""


def figure(content: str, title: str = "", caption: str = "") -> str:
    """Return a figure; `content` is markup."""
    heading = f"<h3>{escape(title)}</h3>" if title else ""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"{heading}<figure>{content}{below}</figure>"


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], *, numeric: Sequence[int] = ()) -> str:
    """Return a table of texts, or nothing if it has no rows; `numeric` columns are set to the right."""
    kinds = [' class="n"' if i in numeric else "" for i in range(len(columns))]
    head = "".join(f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, columns, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{kind}>{escape(plain(v))}</td>" for kind, v in zip(kinds, row, strict=True)) + "</tr>\n"
        for row in rows
    )
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>' if body else ""
    )


def bullets(items: Sequence[str], kind: str = "", most: int = 200) -> str:
    """Return a list of texts, or nothing; those beyond `most` are only counted."""
    if not items:
        return ""
    lines = [f"<li>{escape(str(item))}</li>" for item in items[:most]]
    if len(items) > most:
        lines.append(f"<li>and {len(items) - most:,} more, see run.json</li>")
    return f'<ul class="{kind}">{"".join(lines)}</ul>'


def cards(facts: Sequence[tuple[str, str, bool]]) -> str:
    """Return headline figures: value, what it is, and whether it is a warning."""
    return (
        '<div class="cards">'
        + "".join(
            f'<div class="card{" warn" if bad else ""}"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
            for value, name, bad in facts
        )
        + "</div>"
    )


def plain(value: Any) -> str:
    """Return a value from a JSON document as text for a person."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) < 10**12 else str(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)) and len(value) > 24:
        return f"{len(value):,} values"
    if isinstance(value, (dict, list, tuple)):
        return json.dumps(value, ensure_ascii=False, default=str)[:2000]
    return str(value)
