//! The program as others install it: an archive and a Debian package.

mod deb;
mod licences;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

/// Shells, and the file name that each looks for.
const COMPLETIONS: [(&str, &str); 3] =
    [("bash", "tello-ctl"), ("zsh", "_tello-ctl"), ("fish", "tello-ctl.fish")];

/// Files of the repository that come along.
const DOCUMENTS: [&str; 4] = ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"];

/// Licence of the C library, which is in the program of the archive: where Debian has its text.
const LGPL: &str = "/usr/share/common-licenses/LGPL-2.1";

/// Build the release program and pack it: an archive (tar.gz) and a Debian package.
///
/// Both have the program, manual pages, completions, configurations, the documentation and the licences of all that
/// the program is linked from. The program of the archive needs no library of the system. They go to target/package.
/// Needs tar, gzip, strip and objdump, the static C library and its licence (libc6-dev and base-files on Debian), and
/// dpkg-deb for the Debian package.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Pack this program instead of building one; its library and their dependencies are beside it, as cargo leaves
    /// them.
    #[arg(long, value_name = "FILE")]
    binary: Option<PathBuf>,
    /// Hardly compressed: to try them.
    #[arg(long)]
    quick: bool,
    /// The folder of the packages; made if it does not exist.
    #[arg(long, value_name = "DIR", default_value = "target/package")]
    out: PathBuf,
    /// Who is named in the Debian package.
    #[arg(
        long,
        value_name = "NAME <ADDRESS>",
        default_value = "The tello-ctl authors <authors@tello-ctl.invalid>"
    )]
    maintainer: String,
    /// Print the licences of all that the program is linked from, and build nothing.
    #[arg(long)]
    licences: bool,
}

/// Contents of a package of any format.
struct Contents {
    version: &'static str,
    /// The program, for systems with our C library or a newer one.
    binary: PathBuf,
    /// The program with the C library inside.
    static_binary: PathBuf,
    /// Manual pages, one for each command.
    man: PathBuf,
    /// Completions, named as in [`COMPLETIONS`].
    completions: PathBuf,
    /// Names and licence texts of what the program is linked from.
    third_party: String,
    /// Oldest glibc that has all symbols that the program needs.
    glibc: String,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("no workspace")?;
    let packages = licences::of_program(root)?;
    licences::refuse_others(&packages)?;
    if arguments.licences {
        print!("{}", licences::table(&packages));
        return Ok(());
    }
    let out = root.join(&arguments.out);
    fs::create_dir_all(&out)?;
    let contents = contents(root, &out, arguments.binary.as_deref(), licences::texts(&packages)?)?;
    println!("{}", archive(root, &out, &contents, arguments.quick)?);
    if !is_installed("dpkg-deb") {
        println!("no Debian package: dpkg-deb is missing");
        return Ok(());
    }
    println!("{}", deb::build(root, &out, &contents, arguments)?);
    println!("the program of the Debian package needs glibc {} or newer", contents.glibc);
    Ok(())
}

/// Builds the program, unless there is one, and lets it write what belongs to it.
fn contents(
    root: &Path,
    out: &Path,
    binary: Option<&Path>,
    third_party: String,
) -> Result<Contents> {
    let binary = match binary {
        Some(binary) => binary.to_owned(),
        None => build(root)?,
    };
    let (man, completions) = (out.join("man"), out.join("completions"));
    for folder in [&man, &completions] {
        empty(folder)?;
    }
    output(Command::new(&binary).arg("man").arg(&man))?;
    for (shell, name) in COMPLETIONS {
        let script = output(Command::new(&binary).args(["completions", shell]))?;
        fs::write(completions.join(name), script)?;
    }
    let glibc = newest_glibc(&output(Command::new("objdump").arg("-T").arg(&binary))?)
        .context("the program names no version of glibc")?;
    // A debug build has its lines of code inside.
    let stripped = out.join("tello-ctl");
    output(Command::new("strip").arg("-o").arg(&stripped).arg(&binary))?;
    let static_binary = out.join("tello-ctl-static");
    link_static(root, &binary, &static_binary)?;
    Ok(Contents {
        version: env!("CARGO_PKG_VERSION"),
        binary: stripped,
        static_binary,
        man,
        completions,
        third_party,
        glibc,
    })
}

/// Builds the release program.
pub(crate) fn build(root: &Path) -> Result<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo)
        .args(["build", "--release", "--locked", "--package", "tello-ctl", "--lib", "--bins"])
        .current_dir(root)
        .status()?;
    ensure!(built.success(), "the program does not build");
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
    Ok(root.join(target).join("release/tello-ctl"))
}

/// Links the program anew with the C library inside, from the library that cargo left beside `binary`: its `main` is
/// compiled, nothing else. Another target or flags for all would build every dependency once more.
fn link_static(root: &Path, binary: &Path, to: &Path) -> Result<()> {
    let folder = binary.parent().context("no folder of the program")?;
    let library = folder.join("libtello_ctl.rlib");
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    output(
        Command::new(rustc)
            .args(["--crate-name", "tello_ctl_static", "--edition", "2024", "--crate-type", "bin"])
            .args(["-C", "target-feature=+crt-static", "-C", "strip=symbols"])
            .arg(format!("--extern=tello_ctl={}", library.display()))
            .arg(format!("-Ldependency={}", folder.join("deps").display()))
            .arg(root.join("crates/cli/src/main.rs"))
            .arg("-o")
            .arg(to)
            .current_dir(root),
    )?;
    Ok(())
}

/// The newest `GLIBC_x.y` in a list of dynamic symbols.
fn newest_glibc(symbols: &str) -> Option<String> {
    let versions = symbols.split(|c: char| c.is_whitespace() || c == '(' || c == ')');
    let versions = versions.filter_map(|word| word.strip_prefix("GLIBC_"));
    let number = |version: &&str| -> Vec<u32> {
        version.split('.').map(|part| part.parse().unwrap_or(0)).collect()
    };
    versions.max_by_key(number).map(str::to_owned)
}

/// `tello-ctl-VERSION-linux-ARCH.tar.gz`, with one folder of this name inside.
fn archive(root: &Path, out: &Path, contents: &Contents, is_quick: bool) -> Result<String> {
    let name = format!("tello-ctl-{}-linux-{}", contents.version, std::env::consts::ARCH);
    let top = out.join(&name);
    empty(&top)?;
    copy(&contents.static_binary, &top.join("tello-ctl"), 0o755)?;
    for document in DOCUMENTS {
        copy(&root.join(document), &top.join(document), 0o644)?;
    }
    let lgpl = fs::read_to_string(LGPL).with_context(|| format!("cannot read {LGPL}"))?;
    let third_party = format!(
        "{}\n\nThe GNU C Library, LGPL 2.1 or later, is linked into the program. To use another version of it, build \
         the program from its sources: `cargo xtask package`.\n\n{lgpl}",
        contents.third_party
    );
    fs::write(top.join("THIRD-PARTY.txt"), third_party)?;
    for (from, to) in [(&contents.man, "man/man1"), (&contents.completions, "completions")] {
        copy_tree(from, &top.join(to))?;
    }
    for folder in ["configs", "docs"] {
        copy_tree(&root.join(folder), &top.join(folder))?;
    }
    let file = out.join(format!("{name}.tar.gz"));
    output(
        Command::new("tar")
            .args(["--create", "--use-compress-program"])
            .args([if is_quick { "gzip -1n" } else { "gzip -9n" }, "--sort=name"])
            .args(["--owner=0", "--group=0", "--numeric-owner"])
            .arg(format!("--mtime=@{}", changed_s(root)))
            .arg("--file")
            .arg(&file)
            .arg("--directory")
            .arg(out)
            .arg(&name),
    )?;
    fs::remove_dir_all(&top)?;
    described(&file)
}

/// When the last commit was made, so that the packages depend on their contents alone. s since 1970-01-01
fn changed_s(root: &Path) -> String {
    let git = output(Command::new("git").args(["log", "-1", "--format=%ct"]).current_dir(root));
    git.map_or_else(|_| "0".into(), |seconds| seconds.trim().into())
}

/// A path and its size.
fn described(file: &Path) -> Result<String> {
    Ok(format!("{} ({:.1} MB)", file.display(), fs::metadata(file)?.len() as f64 / 1e6))
}

fn empty(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder)?;
    }
    Ok(fs::create_dir_all(folder)?)
}

fn copy(from: &Path, to: &Path, mode: u32) -> Result<()> {
    use std::os::unix::fs::PermissionsExt;

    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::copy(from, to).with_context(|| format!("cannot copy {}", from.display()))?;
    Ok(fs::set_permissions(to, fs::Permissions::from_mode(mode))?)
}

/// All files below `from`, readable by everyone.
fn copy_tree(from: &Path, to: &Path) -> Result<()> {
    for entry in fs::read_dir(from).with_context(|| format!("cannot read {}", from.display()))? {
        let entry = entry?;
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copy_tree(&from, &to)?;
        } else {
            copy(&from, &to, 0o644)?;
        }
    }
    Ok(())
}

fn is_installed(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
}

/// Standard output of a program.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let output = command.output().with_context(|| format!("cannot start {command:?}"))?;
    let complaint = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{command:?} failed: {}\n{complaint}", output.status);
    Ok(String::from_utf8(output.stdout)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_of_glibc_are_compared_as_numbers() {
        let symbols = "0000 DF *UND* 0000 (GLIBC_2.9) read\n0000 DF *UND* 0000 (GLIBC_2.34) open\n\
                       0000 DF *UND* 0000 (GLIBC_2.2.5) close\n0000 DF *UND* (GCC_3.0) _Unwind";
        assert_eq!(newest_glibc(symbols).as_deref(), Some("2.34"));
        assert_eq!(newest_glibc("0000 DF *UND* (GCC_3.0) _Unwind"), None);
    }
}
