//! Figures of scripts beside those of messages, on Python Wrapyfi and on the package `wrapyfi_rs` by turns.

use std::time::Duration;

use anyhow::Result;

use crate::payload::Kind::VgaRgb;
use crate::python::Python;
use crate::report::Limit::{AtLeast, AtMost};
use crate::report::{Row, Target, quantile};

/// Time for which a listener waits.
const WAIT: Duration = Duration::from_secs(3);

/// Requests for a picture, a listener to which nothing comes, and the import.
pub(crate) fn run(wrapyfi: &mut Python, ours: &mut Python, rounds: u32) -> Result<Vec<Target>> {
    let mut found: [[Vec<f64>; 3]; 2] = Default::default();
    let [theirs, us] = &mut found;
    for _ in 0..rounds {
        for (python, requests, [asked, waiting, import]) in
            [(&mut *wrapyfi, 4, &mut *theirs), (&mut *ours, 40, &mut *us)]
        {
            asked.push(python.asked(VgaRgb, requests)?);
            waiting.push(python.waiting(WAIT)?);
            import.push(python.import()?);
        }
    }
    let [[asked, waiting, import], [our_asked, our_waiting, our_import]] = &found;
    let middle = |of: &[f64]| quantile(of, 0.5);
    let ratios: Vec<f64> = asked.iter().zip(our_asked).map(|(one, other)| one / other).collect();
    let row = |unit, what: &'static str| Row::new("package", unit, what);
    Ok(vec![
        Target::of(
            row(
                "ratio",
                "request and reply of a 640x480 RGB picture, Python against the same script on wrapyfi_rs",
            ),
            AtLeast(100.0),
            &ratios,
            format!("{:.0} / {:.0} us", middle(asked), middle(our_asked)),
        ),
        Target::of(
            row("%", "a listener of wrapyfi_rs to which nothing comes: percent of a core"),
            AtMost(0.5),
            our_waiting,
            format!("Wrapyfi {:.1}", middle(waiting)),
        ),
        Target::of(
            row("ms", "import of wrapyfi_rs.connect.wrapper, ms"),
            AtMost(80.0),
            our_import,
            format!("Wrapyfi {:.0}", middle(import)),
        ),
    ])
}
