//! The Debian package.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::Result;

use super::{
    Arguments, COMPLETIONS, Contents, DOCUMENTS, changed_s, copy, copy_tree, described, empty,
    output,
};

/// Licences in the format of Debian's copyright files.
const COPYRIGHT: &str = "\
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: tello-ctl

Files: *
Copyright: 2026 The tello-ctl authors
License: MIT or Apache-2.0
Comment: The program is linked from packages of others. THIRD-PARTY.txt.gz beside this file has their names and licences.
";

/// `tello-ctl_VERSION_ARCH.deb`.
pub(super) fn build(
    root: &Path,
    out: &Path,
    contents: &Contents,
    arguments: &Arguments,
) -> Result<String> {
    let tree = out.join("deb");
    empty(&tree)?;
    fill(root, &tree, contents)?;
    let installed_kb = output(Command::new("du").args(["-sk", "--apparent-size"]).arg(&tree))?;
    let installed_kb = installed_kb.split_whitespace().next().unwrap_or("0");
    let architecture = output(Command::new("dpkg").arg("--print-architecture"))?;
    let architecture = architecture.trim();
    let control = tree.join("DEBIAN");
    fs::create_dir(&control)?;
    fs::write(
        control.join("control"),
        format!(
            "Package: tello-ctl\nVersion: {}\nArchitecture: {architecture}\nMaintainer: {}\n\
             Section: science\nPriority: optional\nInstalled-Size: {installed_kb}\n\
             Depends: libc6 (>= {}), libgcc-s1\n\
             Description: position control of a Ryze Tello by motion capture\n \
             Moving horizon estimation and model predictive control at 50 Hz, system\n \
             identification, reports, and a simulator that speaks the same protocols.\n",
            contents.version, arguments.maintainer, contents.glibc
        ),
    )?;
    let sums = output(
        Command::new("find")
            .args(["usr", "-type", "f", "-exec", "md5sum", "{}", "+"])
            .current_dir(&tree),
    )?;
    let mut sums: Vec<&str> = sums.lines().collect();
    sums.sort_by_key(|line| line.split_once("  ").map(|(_, path)| path));
    fs::write(control.join("md5sums"), sums.join("\n") + "\n")?;
    let compression: &[&str] = if arguments.quick { &["-Zgzip", "-z1"] } else { &["-Zxz"] };
    let file = out.join(format!("tello-ctl_{}_{architecture}.deb", contents.version));
    output(
        Command::new("dpkg-deb")
            .arg("--root-owner-group")
            .args(compression)
            .arg("--build")
            .arg(&tree)
            .arg(&file)
            .env("SOURCE_DATE_EPOCH", changed_s(root)),
    )?;
    fs::remove_dir_all(&tree)?;
    described(&file)
}

/// Files where Debian expects them.
fn fill(root: &Path, tree: &Path, contents: &Contents) -> Result<()> {
    copy(&contents.binary, &tree.join("usr/bin/tello-ctl"), 0o755)?;
    copy_tree(&contents.man, &tree.join("usr/share/man/man1"))?;
    let folders =
        ["bash-completion/completions", "zsh/vendor-completions", "fish/vendor_completions.d"];
    for ((_, name), folder) in COMPLETIONS.into_iter().zip(folders) {
        let to = tree.join("usr/share").join(folder).join(name);
        copy(&contents.completions.join(name), &to, 0o644)?;
    }
    copy_tree(&root.join("configs"), &tree.join("usr/share/tello-ctl/configs"))?;
    let doc = tree.join("usr/share/doc/tello-ctl");
    for document in DOCUMENTS {
        copy(&root.join(document), &doc.join(document), 0o644)?;
    }
    copy_tree(&root.join("docs"), &doc.join("docs"))?;
    fs::write(doc.join("copyright"), COPYRIGHT)?;
    fs::write(doc.join("THIRD-PARTY.txt"), &contents.third_party)?;
    fs::rename(doc.join("CHANGELOG.md"), doc.join("changelog"))?;
    let compressed = fs::read_dir(tree.join("usr/share/man/man1"))?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<Vec<_>>>()?;
    output(
        Command::new("gzip")
            .args(["-9n"])
            .args(compressed)
            .args([doc.join("THIRD-PARTY.txt"), doc.join("changelog")]),
    )?;
    Ok(())
}
