//! Which source a command looks at: by kind and address, or by the settings of a flight.

use std::net::Ipv6Addr;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Result, bail};
use tello_io::config::{self, FlyTable};
use tello_io::mocap::{MocapKind, MocapTable};

/// Numbers of frames of a source that does not announce its rate are counted in this. Hz
const ANY_RATE_HZ: f64 = 1000.0;

/// A source as given on the command line: `natnet=192.168.1.5:1510`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SourceArgument {
    kind: MocapKind,
    address: String,
}

impl SourceArgument {
    /// The source of a kind at its usual port of `host`.
    pub(super) fn usual(kind: MocapKind, host: &str) -> Self {
        Self { kind, address: usual_address(kind, host) }
    }

    /// Settings of the source for one of its objects.
    pub(super) fn table(&self, object: &str) -> MocapTable {
        self.kind.table(self.address.clone(), object.to_owned(), ANY_RATE_HZ)
    }
}

/// Where a source of a kind is on `host`. An object stream is sent to us.
pub(crate) fn usual_address(kind: MocapKind, host: &str) -> String {
    let host = if kind == MocapKind::Udp { "0.0.0.0" } else { host };
    with_port(host, kind.usual_port())
}

/// `host` and `port`, with brackets about an address whose colons are its own.
fn with_port(host: &str, port: u16) -> String {
    match host.parse::<Ipv6Addr>() {
        Ok(host) => format!("[{host}]:{port}"),
        Err(_) => format!("{host}:{port}"),
    }
}

impl FromStr for SourceArgument {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let names = MocapKind::ALL.map(MocapKind::name).join(", ");
        let Some((name, address)) = text.split_once('=') else {
            bail!("`{text}` is not KIND=HOST:PORT; kinds are {names}");
        };
        let Some(kind) = MocapKind::named(name) else {
            bail!("`{name}` is no kind of source; kinds are {names}");
        };
        let port = match address.rsplit_once(':') {
            Some((_, port)) if address.parse::<Ipv6Addr>().is_err() && !address.ends_with(']') => {
                Some(port)
            }
            _ => None,
        };
        if let Some(port) = port.filter(|port| port.parse::<u16>().is_err()) {
            bail!("`{port}` of `{text}` is no port, 0 to 65535");
        }
        let usual = || with_port(address, kind.usual_port());
        let address = port.map_or_else(usual, |_| address.to_owned());
        Ok(Self { kind, address })
    }
}

/// The source in the settings of a flight.
pub(super) fn of_settings(file: Option<&PathBuf>) -> Result<MocapTable> {
    let table = match file {
        Some(file) => config::load::<FlyTable>(file)?,
        None => config::fly(None, None)?.0,
    };
    Ok(table.mocap)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_a_kind_and_an_address_with_the_usual_port_if_there_is_none() {
        let parsed = |text: &str| text.parse::<SourceArgument>().unwrap();
        assert_eq!(parsed("natnet=motive").address, "motive:1510");
        assert_eq!(parsed("qtm=10.0.0.1:9").address, "10.0.0.1:9");
        assert_eq!(parsed("natnet=::1").address, "[::1]:1510");
        assert_eq!(parsed("natnet=[::1]:9").address, "[::1]:9");
        for kind in MocapKind::ALL {
            let table = parsed(&format!("{}=a:1", kind.name())).table("tello");
            assert_eq!((table.kind(), table.address().1), (kind, "a:1"));
        }
        assert_eq!(parsed("natnet=[::1]").address, "[::1]:1510");
        for (text, reason) in [
            ("motive", "is not KIND=HOST:PORT"),
            ("optitrack=a", "is no kind"),
            ("relay=127.0.0.1:99999", "`99999` of `relay=127.0.0.1:99999` is no port"),
            ("relay=a:", "is no port"),
        ] {
            let error = text.parse::<SourceArgument>().unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
