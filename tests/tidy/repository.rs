//! The repository as text files.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// A text file of the repository; its path starts at the root.
pub(crate) struct File {
    pub(crate) path: String,
    pub(crate) text: String,
}

impl File {
    pub(crate) fn new(path: &str, text: &str) -> Self {
        Self { path: path.into(), text: text.into() }
    }

    pub(crate) fn is_in(&self, places: &[&str]) -> bool {
        places.iter().any(|place| {
            self.path == *place || (place.ends_with('/') && self.path.starts_with(place))
        })
    }

    /// Line numbers and lines before the module of unit tests; none in a file of tests.
    pub(crate) fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let begins = ["mod tests {", "pub(super) mod tests {", "pub(crate) mod tests {"];
        let begins = begins.map(|module| self.text.find(&format!("#[cfg(test)]\n{module}")));
        let end = begins.into_iter().flatten().min().unwrap_or(self.text.len());
        let code = self.text.get(..end).unwrap_or_default();
        let is_test = self.path.ends_with("tests.rs") || self.path.contains("/tests/");
        let code = if is_test { "" } else { code };
        code.lines().enumerate().map(|(i, line)| (i + 1, line))
    }
}

pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Every file of the repository whose name ends in `ending`, in the order of the paths.
pub(crate) fn files(ending: &str) -> io::Result<Vec<File>> {
    const SKIPPED: [&str; 4] = ["target", "logs", ".git", ".venv"];
    let root = root();
    let mut found = Vec::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder)? {
            let (entry, path) = entry.map(|entry| (entry.file_name(), entry.path()))?;
            let name = entry.to_string_lossy();
            if path.is_dir() && !SKIPPED.contains(&name.as_ref()) {
                folders.push(path);
            } else if path.is_file() && name.ends_with(ending) {
                let from_root = path.strip_prefix(&root).unwrap_or(&path).to_string_lossy();
                found.push(File::new(&from_root, &fs::read_to_string(&path)?));
            }
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

/// Text of the file `path`.
pub(crate) fn document(path: &str) -> io::Result<String> {
    fs::read_to_string(root().join(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Modules of a library whose table of files does not name them; nothing for a library without a table.
    fn missing(library: &str) -> Vec<&str> {
        if !library.contains("//! | file") {
            return Vec::new();
        }
        let declared = library.lines().filter_map(|line| {
            let line = line.strip_prefix("pub ").unwrap_or(line);
            line.strip_prefix("mod ")?.strip_suffix(';')
        });
        declared.filter(|name| !library.contains(&format!("//! | `{name}.rs`"))).collect()
    }

    #[test]
    fn the_table_of_a_library_names_all_of_its_files() -> io::Result<()> {
        let libraries: Vec<File> =
            files("lib.rs")?.into_iter().filter(|file| file.path.ends_with("src/lib.rs")).collect();
        assert!(libraries.len() >= 8, "{}", libraries.len());
        for library in &libraries {
            assert_eq!(missing(&library.text), Vec::<&str>::new(), "{}", library.path);
        }
        assert_eq!(missing("//! | file |\n//! | `a.rs` | x |\nmod a;\npub mod b;"), ["b"]);
        Ok(())
    }
}
