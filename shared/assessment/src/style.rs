//! The page's look: one style sheet, for light and dark screens and for paper. Colours are variables, so that the plots follow.

/// The style sheet. What is for narrow windows and for paper stands last: of two rules alike the later one counts, whatever the medium of the first.
pub(crate) const STYLE: &str = "\
:root{color-scheme:light dark;--paper:#fff;--panel:#f8fafc;--ink:#0f172a;--soft:#57606f;--line:#dfe4ea;--good:#15803d;--bad:#b91c1c;--warn:#b45309;\
--force:#b91c1c;--insertion:#1d4ed8;--pressure:#0f766e;--deficit:#7c3aed;--removed:#a16207;--light:#475569;--band:#0f766e22}\
@media (prefers-color-scheme:dark){:root{--paper:#0f141b;--panel:#182029;--ink:#e6eaf0;--soft:#9aa5b4;--line:#2c3643;--good:#4ade80;--bad:#f87171;--warn:#fbbf24;\
--force:#f87171;--insertion:#60a5fa;--pressure:#2dd4bf;--deficit:#c4b5fd;--removed:#facc15;--light:#cbd5e1;--band:#2dd4bf22}}\
*{box-sizing:border-box}body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:1120px;margin:2rem auto;padding:0 1rem}\
h1{font-size:1.6rem;margin:0 0 .6rem}h1,p,li,figcaption{overflow-wrap:anywhere}h2{font-size:1.15rem;margin:2.2rem 0 .6rem;border-bottom:1px solid var(--line);padding-bottom:.2rem}\
p.note{color:var(--soft);max-width:78ch;margin:.3rem 0 .8rem}dl{display:grid;grid-template-columns:max-content 1fr;gap:.1rem 1.2rem;margin:0}dt{color:var(--soft)}\
dd{margin:0;overflow-wrap:anywhere;font-variant-numeric:tabular-nums}.missing{border-left:4px solid var(--warn);background:var(--panel);padding:.6rem 1rem;margin:1rem 0}\
.missing ul{margin:.3rem 0 0;padding-left:1.2rem}.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:.8rem;margin:1.4rem 0}\
.tile{background:var(--panel);border:1px solid var(--line);border-radius:10px;padding:.7rem .9rem}.tile b{display:block;font-size:1.7rem;line-height:1.2;font-variant-numeric:tabular-nums}\
.tile span{color:var(--soft)}.tile small{display:block;color:var(--soft)}.over-time{min-width:680px}\
.wide{overflow-x:auto}:focus-visible{outline:3px solid var(--insertion);outline-offset:2px}table{border-collapse:collapse;width:100%;font-size:13.5px}\
th{text-align:right;color:var(--soft);font-weight:600;border-bottom:2px solid var(--line);padding:.3rem .5rem;vertical-align:bottom}\
td{text-align:right;border-bottom:1px solid var(--line);padding:.28rem .5rem;font-variant-numeric:tabular-nums;white-space:nowrap}\
th:first-child,td:first-child,td.text,th.text{text-align:left}td.text{white-space:normal}tr.group td{background:var(--panel);font-weight:600}\
.bar{display:inline-block;width:70px;height:.6em;border-radius:.3em;background:var(--line);margin-left:.5rem;overflow:hidden;vertical-align:.02em}\
.bar i{display:block;height:100%;background:var(--good)}.bar i.middle{background:var(--warn)}.bar i.low{background:var(--bad)}td.source{color:var(--soft);font-size:12px}\
.reached{color:var(--good)}.error{color:var(--bad)}.warning{color:var(--warn)}.takeover{color:var(--insertion)}svg{width:100%;height:auto;display:block}\
svg text{font:11.5px system-ui,sans-serif;fill:var(--soft)}svg text.title{fill:var(--ink);font-weight:600}.grid{stroke:var(--line)}.frame{fill:none;stroke:var(--line)}\
.band{fill:var(--band)}.limit{stroke:var(--soft);stroke-dasharray:5 4}.curve{stroke-width:1.3;stroke-linejoin:round;fill-opacity:.35}\
.force{fill:var(--force);stroke:var(--force)}.insertion{fill:var(--insertion);stroke:var(--insertion)}.pressure{fill:var(--pressure);stroke:var(--pressure)}\
.deficit{fill:var(--deficit);stroke:var(--deficit)}.removed{fill:var(--removed);stroke:var(--removed)}.light{fill:var(--light);stroke:var(--light)}.mark{stroke-width:1.2;opacity:.75}\
.mark.error{stroke:var(--bad)}.mark.warning{stroke:var(--warn)}.mark.takeover{stroke:var(--insertion)}\
.mark.goal{stroke:var(--good);stroke-width:2}.mark.warned{stroke:var(--warn);stroke-dasharray:3 3}.mark.alarm{stroke:var(--bad);stroke-dasharray:3 3}.current{fill:var(--ink);opacity:.6}.way{fill:none;stroke:var(--insertion);stroke-width:1;stroke-linejoin:round;opacity:.8}\
.organ{fill:none;stroke:var(--soft);stroke-width:1.2;opacity:.7}.pathology{fill:var(--removed);opacity:.25}\
.dot{stroke:var(--paper)}.dot.begin{fill:var(--good)}.dot.end{fill:var(--ink)}.dot.peak{fill:var(--force)}\
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(250px,1fr));gap:1rem}figure{margin:0;break-inside:avoid}\
figure img{width:100%;height:auto;display:block;border-radius:8px;background:#000}figcaption{color:var(--soft);font-size:13.5px;margin-top:.3rem}\
figcaption b{color:var(--ink);font-variant-numeric:tabular-nums}\
.sides{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(340px,100%),1fr));gap:1rem}.key span{margin-right:1.2rem;white-space:nowrap}\
.key i{display:inline-block;width:.8em;height:.8em;border-radius:50%;margin-right:.35em;vertical-align:-.05em}\
@media (max-width:640px){dl{grid-template-columns:1fr}dd{margin-bottom:.4rem}td,th{padding:.25rem .3rem}td:first-child{white-space:normal;min-width:9em}\
td.source{min-width:20em}.bar{width:36px}}\
@media print{:root{color-scheme:light;--paper:#fff;--panel:#fff;--ink:#000;--soft:#333;--line:#bbb;--good:#15803d;--bad:#b91c1c;--warn:#b45309;\
--force:#b91c1c;--insertion:#1d4ed8;--pressure:#0f766e;--deficit:#7c3aed;--removed:#a16207;--light:#475569;--band:#0f766e22}\
body{margin:0;padding:0;max-width:none;font-size:11px}table,td.source,figcaption{font-size:9.5px}td,th{padding:.15rem .3rem}\
td:first-child{white-space:normal;min-width:0}td.source{min-width:0}\
.wide{overflow:visible}.over-time{min-width:0}.bar{width:36px}h2{break-after:avoid}tr,svg,figure,.tile,.missing{break-inside:avoid}\
.bar i{print-color-adjust:exact;-webkit-print-color-adjust:exact}}";

#[cfg(test)]
mod tests {
    use super::*;

    /// The margins and letters for paper stood before those for screens, and were never seen.
    #[test]
    fn what_is_for_paper_comes_after_all_that_it_changes() {
        let (screens, paper) = STYLE.split_once("@media print{").unwrap();
        for rule in ["body{", "table{", "td{", "th{", "td.source{", ".wide{", ".over-time{", ".bar{", "figcaption{"] {
            assert!(screens.contains(rule), "{rule}");
        }
        assert!(!paper.contains("@media") && STYLE.matches('{').count() == STYLE.matches('}').count());
    }
}
