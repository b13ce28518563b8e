//! The book of the documentation: `docs/SUMMARY.md` names every page, and its pictures are few, small and used.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{fs, io};

use super::repository::{File, document, files, root};

/// Largest picture. bytes
const PICTURE_MAX: usize = 100_000;

/// Most pictures.
const PICTURES_MAX: usize = 10;

/// Targets of the links of a page.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next())
}

/// Pages, by their paths below `docs/`, that the summary does not name once.
fn summary_complaints(summary: &str, pages: &[&str]) -> Vec<String> {
    let count = |page: &str| links(summary).filter(|link| *link == page).count();
    pages
        .iter()
        .filter(|page| count(page) != 1)
        .map(|page| format!("docs/SUMMARY.md names {page} {} times", count(page)))
        .collect()
}

/// Links of a page that lead out of `docs/`: the book has nothing there.
fn outward_complaints(page: &str, text: &str) -> Vec<String> {
    let depth = page.matches('/').count();
    links(text)
        .filter(|link| !link.contains("://") && link.matches("../").count() > depth)
        .map(|link| format!("docs/{page}: {link} is not in the book"))
        .collect()
}

/// The anchors of a page: its headings in lower case, with `-` for spaces and without other signs.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut is_code = false;
    let headings = text.lines().filter(|line| {
        is_code ^= line.starts_with("```");
        !is_code && line.starts_with('#')
    });
    let anchor = |heading: &str| -> String {
        let heading = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

/// Links to an anchor, of the page itself or of another one, that no heading has.
fn anchor_complaints(
    file: &File,
    anchors_of: impl Fn(&Path) -> Option<BTreeSet<String>>,
) -> Vec<String> {
    let links = file.text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let named = links.filter(|link| !link.contains("://")).filter_map(|link| link.split_once('#'));
    let folder = Path::new(&file.path).parent().unwrap_or(Path::new(""));
    let is_there = |page: &str, anchor: &str| {
        let page = if page.is_empty() { PathBuf::from(&file.path) } else { folder.join(page) };
        anchors_of(&page).is_some_and(|anchors| anchors.contains(anchor))
    };
    named
        .filter(|(page, anchor)| !is_there(page, anchor))
        .map(|(page, anchor)| format!("{}: {page}#{anchor} is no heading", file.path))
        .collect()
}

#[test]
fn links_to_headings_find_them() -> io::Result<()> {
    let read = |page: &Path| fs::read_to_string(root().join(page)).ok().map(|text| anchors(&text));
    let documents = files(".md")?;
    let complaints: Vec<_> =
        documents.iter().flat_map(|file| anchor_complaints(file, read)).collect();
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
    Ok(())
}

#[test]
fn a_link_to_a_missing_heading_is_seen() {
    let page = "# Wire formats\n## Mocap: `natnet` (OptiTrack)\n```sh\n# no heading\n```\n";
    let found = anchors(page);
    assert_eq!(found, ["mocap-natnet-optitrack", "wire-formats"].map(str::to_owned).into());
    let read = |path: &Path| (path == Path::new("docs/a.md")).then(|| found.clone());
    for (link, count) in [
        ("a.md#wire-formats", 0),
        ("#wire-formats", 1),
        ("a.md#nothing", 1),
        ("b.md#x", 1),
        ("https://a.example/#x", 0),
    ] {
        let file = File::new("docs/c.md", &format!("see [this]({link})"));
        assert_eq!(anchor_complaints(&file, read).len(), count, "{link}");
    }
}

#[test]
fn every_page_is_in_the_book_and_links_stay_inside() -> io::Result<()> {
    let documents = files(".md")?;
    let pages = documents.iter().filter_map(|file| Some((file.path.strip_prefix("docs/")?, file)));
    let pages: Vec<_> = pages.filter(|(page, _)| *page != "SUMMARY.md").collect();
    assert!(pages.len() > 20, "only {} pages", pages.len());
    let names: Vec<&str> = pages.iter().map(|(page, _)| *page).collect();
    let mut complaints = summary_complaints(&document("docs/SUMMARY.md")?, &names);
    complaints.extend(pages.iter().flat_map(|(page, file)| outward_complaints(page, &file.text)));
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
    Ok(())
}

#[test]
fn pictures_of_the_book_are_few_small_and_used() -> io::Result<()> {
    let documents = files(".md")?;
    let pictures = files(".svg")?;
    for File { path, text, .. } in &pictures {
        assert!((1000..=PICTURE_MAX).contains(&text.len()), "{path}: {} bytes", text.len());
        let folder = |document: &File| Path::new(&document.path).parent().map(Path::to_owned);
        let shows = |document: &File| {
            folder(document).is_some_and(|folder| {
                links(&document.text).any(|link| Path::new(path) == folder.join(link))
            })
        };
        assert!(documents.iter().any(shows), "no page shows {path}");
    }
    let count = pictures.len();
    assert!((1..=PICTURES_MAX).contains(&count), "{count} pictures");
    Ok(())
}

#[test]
fn a_missing_page_and_a_link_out_of_the_book_are_seen() {
    let summary = "- [A](a.md)\n  - [B](b/README.md)\n- [A again](a.md)\n";
    assert_eq!(summary_complaints(summary, &["b/README.md"]), Vec::<String>::new());
    assert_eq!(summary_complaints(summary, &["a.md", "c.md"]).len(), 2);
    for (page, link, count) in [
        ("a.md", "../configs/fly.json", 1),
        ("a.md", "control/a.svg", 0),
        ("b/README.md", "../a.md", 0),
        ("b/README.md", "../../README.md", 1),
        ("a.md", "https://example.org/../x", 0),
    ] {
        let text = format!("see [this]({link})");
        assert_eq!(outward_complaints(page, &text).len(), count, "{page}: {link}");
    }
}
