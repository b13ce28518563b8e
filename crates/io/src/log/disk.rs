//! How much a log may still grow.

use std::path::Path;

use nix::sys::statvfs::statvfs;

/// Free space where `folder` is or will be made; `None` if the system does not report it. bytes
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let mut ancestors = folder.ancestors().filter(|folder| folder.exists());
    let found = statvfs(ancestors.next().unwrap_or(Path::new("."))).ok()?;
    found.blocks_available().checked_mul(found.fragment_size())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_does_not_exist_yet_has_the_space_of_the_one_above() {
        let free = |folder| free_bytes(Path::new(folder)).unwrap();
        for folder in ["/", ".", "/no-such-folder/logs", "no-such-folder"] {
            assert!(free(folder) > 0, "{folder}");
        }
        assert_eq!(free_bytes(Path::new("/proc/1")), Some(0), "a file system that holds nothing");
    }
}
