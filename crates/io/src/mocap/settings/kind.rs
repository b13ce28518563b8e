//! Kinds of mocap sources: their names, their usual ports and whether their rate is a setting.

use strum::IntoStaticStr;

use super::{MocapTable, NatnetTable, QtmTable, ServerTable, UdpTable, VrpnTable};

/// Kind of a mocap source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum MocapKind {
    /// Lines of the text relay, over TCP.
    Relay,
    /// Object stream of Vicon Tracker, over UDP.
    Udp,
    /// DataStream of Vicon, over TCP.
    Datastream,
    /// NatNet of OptiTrack, over UDP.
    Natnet,
    /// Real-time protocol of Qualisys, over TCP.
    Qtm,
    /// VRPN, over TCP.
    Vrpn,
}

impl MocapKind {
    /// All kinds, in the order in which messages list them.
    pub const ALL: [Self; 6] =
        [Self::Relay, Self::Udp, Self::Datastream, Self::Natnet, Self::Qtm, Self::Vrpn];

    /// Key of the source in the settings.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The kind of this name. `None`: there is no such kind.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Port of the server, or the local port of an object stream.
    pub const fn usual_port(self) -> u16 {
        match self {
            Self::Relay => 51602,
            Self::Udp => 51001,
            Self::Datastream => 801,
            Self::Natnet => 1510,
            Self::Qtm => 22223,
            Self::Vrpn => 3883,
        }
    }

    /// Whether the source does not announce its rate, which is a setting then.
    pub fn has_set_rate(self) -> bool {
        matches!(self, Self::Udp | Self::Vrpn)
    }

    /// Settings of a source at `address` for `object`, with our frame; `rate_hz` if the rate is a setting.
    pub fn table(self, address: String, object: String, rate_hz: f64) -> MocapTable {
        let frame = None;
        match self {
            Self::Relay => MocapTable::Relay(ServerTable { address, object }),
            Self::Udp => MocapTable::Udp(UdpTable { listen: address, object, rate_hz }),
            Self::Datastream => MocapTable::Datastream(ServerTable { address, object }),
            Self::Natnet => {
                MocapTable::Natnet(NatnetTable { address, object, rate_hz: None, frame })
            }
            Self::Qtm => MocapTable::Qtm(QtmTable { address, object, frame }),
            Self::Vrpn => MocapTable::Vrpn(VrpnTable { address, object, rate_hz, frame }),
        }
    }
}
