//! Shell completions and manual pages.

use super::*;

#[test]
fn completions_and_manual_pages_include_every_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = lenscube(&["completions", shell]).ok().stdout;
        assert!(script.contains("pyramid") && script.contains("take-over"), "{shell}");
    }
    assert_eq!(lenscube(&["completions", "tcsh"]).code, 2);
    let dir = tempfile::tempdir().unwrap();
    let pages = dir.path().join("man1");
    lenscube(&["man", text(&pages)]).ok();
    let names: Vec<String> =
        std::fs::read_dir(&pages).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    let help = lenscube(&["--help"]).ok().stdout;
    let commands = help.split("Simulate:").nth(1).unwrap().split("Options:").next().unwrap();
    let commands = commands
        .lines()
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next());
    let mut count = 0;
    for command in commands.filter(|c| *c != "help") {
        assert!(names.contains(&format!("lenscube-{command}.1")), "{command}: {names:?}");
        count += 1;
    }
    assert!(count > 10 && names.contains(&"lenscube-lens-trace.1".to_owned()), "{names:?}");
    let charts = lenscube(&["help", "charts"]).ok().stdout;
    assert!(charts.starts_with("# Charts\n") && names.contains(&"lenscube-charts.7".to_owned()), "{charts}");
    assert!(lenscube(&["help", "lens", "trace"]).ok().stdout.contains("--max-nodes"));
    assert!(lenscube(&["help"]).ok().stdout.contains("limits"));
    let unknown = lenscube(&["help", "chart", "nowhere"]);
    assert!(unknown.code == 2 && unknown.stderr.contains("accuracy"), "{}", unknown.stderr);
    let page = std::fs::read_to_string(pages.join("lenscube-view.1")).unwrap();
    assert!(page.contains(".TH lenscube") && page.contains("\\-\\-port"), "{page}");
    assert!(lenscube(&["man"]).ok().stdout.contains(".TH lenscube"));
    let listing: serde_json::Value = serde_json::from_str(&lenscube(&["man", "--json"]).ok().stdout).unwrap();
    let run = listing["commands"].as_array().unwrap().iter().find(|c| c["name"] == "run").unwrap();
    let argument =
        |name: &str| run["arguments"].as_array().unwrap().iter().find(|a| a["name"] == name).unwrap();
    let lens = argument("lens");
    assert_eq!((&lens["flag"], &lens["takes_value"]), (&"--lens".into(), &true.into()), "{lens}");
    assert_eq!((&argument("roi")["repeatable"], argument("chart").get("flag")), (&true.into(), None));
    assert_eq!(listing["exit_codes"].as_array().unwrap().len(), 7);
    assert_eq!(lenscube(&["man", "--json", text(&pages)]).code, 2);
}
