# SPDX-License-Identifier: MIT
"""How a report looks, and the one script in it: everything that the page needs, so that it loads nothing."""

STYLE = """
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
.wordy td{overflow-wrap:anywhere;min-width:3.4rem}.wordy td:first-child{min-width:14rem}.wordy td:nth-child(2){min-width:6rem}.wordy td:nth-child(5){white-space:nowrap}.wordy td:last-child{min-width:18rem}
tr.changed td{font-weight:600}.bar{background:var(--c0);height:.7rem;border-radius:2px;min-width:1px;print-color-adjust:exact;-webkit-print-color-adjust:exact}td.wide{width:55%;min-width:8rem;vertical-align:middle}
code,pre{font:13px/1.5 ui-monospace,monospace}pre{background:var(--card);padding:.7rem;border-radius:8px;white-space:pre-wrap;overflow-wrap:anywhere}
.line{fill:none;stroke-width:1.3;vector-effect:non-scaling-stroke;stroke-linejoin:round;stroke-linecap:round}.axis{stroke:var(--soft);fill:none}.grid{stroke:var(--line);fill:none}
.tick{font-size:11px;fill:var(--soft)}.label{font-size:12px;fill:var(--soft)}.mark{stroke:var(--soft);stroke-width:1}
.c0{stroke:var(--c0)}.c1{stroke:var(--c1)}.c2{stroke:var(--c2)}.c3{stroke:var(--c3)}.c4{stroke:var(--c4)}.c5{stroke:var(--c5)}
.map{position:relative;overflow:hidden;background:#fff;border:1px solid var(--line);border-radius:8px;touch-action:pan-y}
.pane{width:fit-content;max-width:100%;margin:auto;transform-origin:0 0}.map img{display:block;max-width:100%;max-height:90vh;margin:auto}.map.zoomed{touch-action:none;cursor:grab}.map.zoomed img{image-rendering:pixelated}
.tools{position:absolute;top:.5rem;right:.5rem;display:none;gap:.3rem}.js .tools{display:flex}
.tools button{font:16px/1 system-ui,sans-serif;min-width:2.2rem;height:2.2rem;border:1px solid #c5ccd5;border-radius:6px;background:#ffffffe0;color:#1d2129;cursor:pointer}
@media(max-width:600px){body{padding:.8rem}.tick{font-size:15px}.label{font-size:16px}}
@media print{body{max-width:none;padding:0;font-size:11px}.tools,.js .tools{display:none}figure,.cards,tr{break-inside:avoid}h2,h3{break-after:avoid}.map{border:0}
:root{--page:#fff;--ink:#000;--soft:#444;--line:#bbb;--card:#fff;--warn:#000;--warnbg:#fff;--c0:#0072b2;--c1:#d55e00;--c2:#009e73;--c3:#cc79a7;--c4:#e69f00;--c5:#56b4e9}}
.dots{fill:none;stroke-width:3.4;stroke-linecap:round}.faint{stroke:var(--soft);stroke-opacity:.45}.dots.faint{stroke-width:2}.limit{stroke:var(--ink);stroke-dasharray:5 4;fill:none}.bar0{fill:var(--c0)}.bar1{fill:var(--c1)}
.m0{fill:var(--card)}.m1{fill:#56b4e9}.m2{fill:#0072b2}.m3{fill:#e69f00}.m4{fill:#d55e00}.open{fill:none;stroke:var(--soft);stroke-width:1}.mt{font-size:9px;fill:#fff}
.layered .map{--soft:#5b6470;--line:#d9dee5;--ink:#1d2129}.layered .pane{width:auto}.graph{max-height:92vh}.switches{display:flex;flex-wrap:wrap;gap:.15rem 1rem;margin:.3rem 0 .5rem;font-size:.87rem}
.switches label{display:inline-flex;align-items:center;gap:.3rem;cursor:pointer}.switches input{margin:0}svg.key{width:22px;height:10px;background:#fff;border-radius:2px}
.layered:has(.s0:not(:checked)) .l0,.layered:has(.s1:not(:checked)) .l1,.layered:has(.s2:not(:checked)) .l2,.layered:has(.s3:not(:checked)) .l3,.layered:has(.s4:not(:checked)) .l4,.layered:has(.s5:not(:checked)) .l5,.layered:has(.s6:not(:checked)) .l6,.layered:has(.s7:not(:checked)) .l7,.layered:has(.s8:not(:checked)) .l8,.layered:has(.s9:not(:checked)) .l9,.layered:has(.s10:not(:checked)) .l10,.layered:has(.s11:not(:checked)) .l11{display:none}
.graph path,.key path{fill:none;vector-effect:non-scaling-stroke;stroke-linecap:round;stroke-linejoin:round}.graph text{font-size:calc(11px/var(--k,1))}
path.track{stroke-width:calc(1.1px/var(--k,1))}.t0{stroke:#1d2129}.t1{stroke:#7a3e9d}.t2{stroke:#00664b}.t3{stroke:#8a5a00}path.alone{stroke:#8c939c;stroke-width:calc(1.2px/var(--k,1));stroke-dasharray:4 3}
path.nodes{stroke:#1d2129;stroke-width:calc(2.6px/var(--k,1))}path.outline{stroke:#009e73;stroke-width:calc(1px/var(--k,1))}path.outline:hover{stroke-opacity:1;stroke-width:calc(3px/var(--k,1))}
.graph text.name{fill:#006b4e;font-weight:600;paint-order:stroke;stroke:#fff;stroke-width:calc(3px/var(--k,1));stroke-linejoin:round}
path.loop{stroke-width:calc(1.2px/var(--k,1))}.r0{stroke:#56b4e9}.r1{stroke:#0072b2}.r2{stroke:#e69f00}.r3{stroke:#d55e00}path.loop.r3{stroke-width:calc(2px/var(--k,1))}
path.rejected{stroke:#cc79a7;stroke-opacity:.7;stroke-width:calc(1px/var(--k,1));stroke-dasharray:2 3}
path.driven{stroke:#009e73;stroke-width:calc(2.2px/var(--k,1))}path.believed{stroke:#56b4e9;stroke-width:calc(1.2px/var(--k,1))}path.planned{stroke:#0072b2;stroke-opacity:.6;stroke-width:calc(1.1px/var(--k,1));stroke-dasharray:5 3}
path.person{stroke:#e69f00;stroke-opacity:.7;stroke-width:calc(1.2px/var(--k,1))}path.recovery{stroke:#7a3e9d;stroke-width:calc(2px/var(--k,1))}path.collision{stroke:#d55e00;stroke-width:calc(2.6px/var(--k,1))}path.reached{stroke:#00664b;stroke-width:calc(2px/var(--k,1))}path.missed{stroke:#d55e00;stroke-width:calc(2.4px/var(--k,1))}
.thumbs{display:grid;grid-template-columns:repeat(auto-fill,minmax(8.5rem,1fr));gap:.6rem}.thumbs div{font-size:.8rem;color:var(--soft)}.thumbs img{width:100%;height:8rem;object-fit:contain;background:#d0d6de;border-radius:6px;image-rendering:pixelated;display:block}
path.keyframes{stroke:#7a3e9d;stroke-width:calc(5px/var(--k,1))}path.shared{stroke:#009e73;stroke-opacity:.3;stroke-width:calc(.8px/var(--k,1))}.thumbs.shots{grid-template-columns:repeat(auto-fill,minmax(13rem,1fr))}
.shot{border-radius:6px;background:#fff}.shot path{fill:none;stroke-linecap:round}.shot .rim{stroke:#000;stroke-opacity:.55;stroke-width:3.2}.shot .point{stroke:#5dff8f;stroke-width:1.9}
.shot .match{stroke-width:.7;stroke-opacity:.85}.match.k0{stroke:#56b4e9}.match.k1{stroke:#e69f00}.match.k2{stroke:#35c79b}.match.k3{stroke:#f0e442}.match.k4{stroke:#ff8a47}.match.k5{stroke:#e19bc4}
.views img{display:block;max-width:100%;max-height:90vh;margin:auto}
"""

# Zooms the map by wheel (with Ctrl or when zoomed), two fingers, buttons and double click; without it the map is a plain image.
SCRIPT = """
(function(){document.documentElement.classList.add('js');
document.querySelectorAll('.map').forEach(function(box){var img=box.querySelector('.pane'),k=1,x=0,y=0,held=new Map(),gap=0;
function show(){var w=img.offsetWidth,h=img.offsetHeight;if(k<=1){k=1;x=y=0}x=Math.min(0,Math.max(w-w*k,x));y=Math.min(0,Math.max(h-h*k,y));
img.style.transform='translate('+x+'px,'+y+'px) scale('+k+')';box.style.setProperty('--k',k);box.classList.toggle('zoomed',k>1)}
function zoom(f,cx,cy){var n=Math.min(40,Math.max(1,k*f));f=n/k;x=cx-(cx-x)*f;y=cy-(cy-y)*f;k=n;show()}
function at(e){var r=box.getBoundingClientRect();return[e.clientX-r.left-img.offsetLeft,e.clientY-r.top-img.offsetTop]}
box.addEventListener('wheel',function(e){if(!e.ctrlKey&&k===1&&e.deltaY>0)return;if(!e.ctrlKey&&!box.matches(':focus-within')&&k===1)return;
e.preventDefault();var p=at(e);zoom(Math.exp(-e.deltaY*.002),p[0],p[1])},{passive:false});
box.addEventListener('dblclick',function(e){if(!img.contains(e.target))return;var p=at(e);k>1?(k=1,show()):zoom(4,p[0],p[1])});
box.addEventListener('pointerdown',function(e){if(!img.contains(e.target))return;held.set(e.pointerId,at(e));gap=0;if(k>1)box.setPointerCapture(e.pointerId)});
box.addEventListener('pointermove',function(e){var o=held.get(e.pointerId);if(!o)return;var p=at(e);held.set(e.pointerId,p);
if(held.size===2){var q=Array.from(held.values()),d=Math.hypot(q[0][0]-q[1][0],q[0][1]-q[1][1]);
if(gap)zoom(d/gap,(q[0][0]+q[1][0])/2,(q[0][1]+q[1][1])/2);gap=d}else if(k>1){x+=p[0]-o[0];y+=p[1]-o[1];show()}});
['pointerup','pointercancel','pointerleave'].forEach(function(n){box.addEventListener(n,function(e){held.delete(e.pointerId);gap=0})});
box.querySelectorAll('button').forEach(function(b){b.addEventListener('click',function(){var f=+b.dataset.zoom;
if(!f){k=1;show()}else zoom(f,img.offsetWidth/2,img.offsetHeight/2)})});
img.draggable=false;})})();
"""
