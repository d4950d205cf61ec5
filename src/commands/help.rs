//! `lenscube help`: the help of a command, or a page of the guide.

use crate::args::{self, HelpArgs};
use crate::failure::usage;
use crate::manual::{PAGES, page};
use crate::progress::print;
use anyhow::Result;

/// Runs the command.
pub fn command(given: &HelpArgs) -> Result<()> {
    let mut command = args::help::command();
    command.build();
    let Some((first, others)) = given.topic.split_first() else {
        print(command.render_help().to_string().trim_end());
        print("\nGuide (`lenscube help TOPIC`):");
        PAGES.iter().for_each(|page| print(format!("  {:<11}{}", page.name, page.about)));
        return Ok(());
    };
    // `lenscube help lens trace`. Of a name that is both, such as depth, the page comes first: `lenscube depth --help` is the command's.
    if let (Some(page), []) = (page(first), others) {
        print(page.text.trim_end());
        return Ok(());
    }
    let mut found = &mut command;
    for name in &given.topic {
        found = found.find_subcommand_mut(name).ok_or_else(|| unknown(&given.topic.join(" ")))?;
    }
    print(found.render_long_help().to_string().trim_end());
    Ok(())
}

fn unknown(topic: &str) -> anyhow::Error {
    let pages: Vec<&str> = PAGES.iter().map(|page| page.name).collect();
    usage(format!(
        "help {topic}: neither a command (`lenscube --help` lists them) nor a page of the guide: {}",
        pages.join(", ")
    ))
}
