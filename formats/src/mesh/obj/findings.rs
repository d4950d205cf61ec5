//! Notes that name materials and files: one per kind, with the first names and the number of the others.

use super::super::context::Context;
use super::super::shown::shown;

/// Names of a note.
const MAX_NAMES: usize = 5;

/// Notes to be.
#[derive(Default)]
pub(super) struct Findings(Vec<Finding>);

struct Finding {
    what: &'static str,
    names: Vec<String>,
    others: u64,
}

impl Findings {
    /// Adds a name to the note `what`; the same name again is not added to its first names.
    pub fn add(&mut self, what: &'static str, name: &str) {
        let at = self.0.iter().position(|f| f.what == what).unwrap_or_else(|| {
            self.0.push(Finding { what, names: Vec::new(), others: 0 });
            self.0.len() - 1
        });
        let (finding, name) = (&mut self.0[at], shown(name));
        match finding.names.contains(&name) {
            true => {}
            false if finding.names.len() < MAX_NAMES => finding.names.push(name),
            false => finding.others += 1,
        }
    }

    /// Notes on all.
    pub fn add_notes(&self, context: &Context<'_>) {
        for Finding { what, names, others } in &self.0 {
            let more = if *others > 0 { format!(" and {others} others") } else { String::new() };
            context.note(format!("{what}: {}{more}", names.join(", ")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Limits;

    #[test]
    fn a_note_has_five_names_and_a_count() {
        let limits = Limits::of_memory(0);
        let context = Context::new(std::path::Path::new("a.obj"), &limits);
        let mut findings = Findings::default();
        (0..9).for_each(|k| findings.add("grey materials", &format!("m{}", k % 8)));
        findings.add("missing", "a b");
        findings.add_notes(&context);
        let expected = [r#"grey materials: "m0", "m1", "m2", "m3", "m4" and 3 others"#, r#"missing: "a b""#];
        assert_eq!(context.take_notes(), expected);
    }
}
