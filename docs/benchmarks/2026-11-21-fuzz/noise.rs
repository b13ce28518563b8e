//! Noise for one mocap source without coverage: `noise SOURCE FILE SECONDS SEED`.
//!
//! FILE is what an emulator sent: bytes of a TCP connection, or datagrams behind their lengths (u32, little-endian) for `udp`
//! and `natnet`. Each run takes a piece of it, changes some of its bytes and pushes it in pieces.
use std::time::{Duration, Instant};
use tello_io::clock::TimeNs;
use tello_io::vicon::{
    NatnetTable, QtmTable, ServerTable, UdpTable, ViconCounters, ViconSettings, ViconStream, ViconTable, VrpnTable,
};

struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % end.max(1)
    }
}

const EXTREMES: [&[u8]; 9] = [
    &[0xff; 4], &[0; 4], &[0x7f, 0xff, 0xff, 0xff], &[0xff, 0xff, 0xff, 0x7f], &[0x80, 0, 0, 0], &[0, 0, 0, 0x80],
    &[0, 0, 0, 0, 0, 0, 0xf8, 0x7f], &[0, 0, 0, 0, 0, 0, 0xf0, 0xff], &[0x10, 0, 0, 0],
];

fn change(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len());
    match random.below(6) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.below(256) as u8,
        2 => drop(bytes.drain(at..(at + random.below(16)).min(bytes.len()))),
        3 => bytes.truncate(at + 1),
        4 => {
            let end = (at + random.below(64)).min(bytes.len());
            let copy = bytes[at..end].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, copy);
        }
        _ => {
            let extreme = EXTREMES[random.below(EXTREMES.len())];
            for (byte, new) in bytes[at..].iter_mut().zip(extreme) {
                *byte = *new;
            }
        }
    }
    if bytes.is_empty() {
        bytes.push(0);
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let (object, address, frame) = (String::from("tello"), String::from("localhost:801"), None);
    let table = match arguments[1].as_str() {
        "relay" => ViconTable::Relay(ServerTable { address, object }),
        "datastream" => ViconTable::Datastream(ServerTable { address, object }),
        "udp" => ViconTable::Udp(UdpTable { listen: "0.0.0.0:51001".into(), object, rate_hz: 100.0 }),
        "natnet" => ViconTable::Natnet(NatnetTable { address, object, rate_hz: None, frame }),
        "qtm" => ViconTable::Qtm(QtmTable { address, object, frame }),
        _ => ViconTable::Vrpn(VrpnTable { address, object, rate_hz: 100.0, frame }),
    };
    let settings = ViconSettings::try_from(&table).unwrap();
    let file = std::fs::read(&arguments[2]).unwrap();
    let is_datagrams = ["udp", "natnet"].contains(&arguments[1].as_str());
    let mut datagrams = Vec::new();
    let mut rest = &file[..];
    while is_datagrams && rest.len() > 4 {
        let length = u32::from_le_bytes(rest[..4].try_into().unwrap()) as usize;
        datagrams.push(rest[4..4 + length].to_vec());
        rest = &rest[4 + length..];
    }
    let end = Instant::now() + Duration::from_secs(arguments[3].parse().unwrap());
    let mut random = Random(arguments[4].parse::<u64>().unwrap() * 0x9e37_79b9_7f4a_7c15 | 1);
    let (mut runs, mut pieces_count, mut sightings, mut given_up, mut slowest) = (0_u64, 0_u64, 0_u64, 0_u64, Duration::ZERO);
    while runs % 256 != 0 || Instant::now() < end {
        runs += 1;
        let mut pieces: Vec<Vec<u8>> = if is_datagrams {
            let from = if random.below(4) > 0 { 0 } else { random.below(datagrams.len()) };
            datagrams[from..(from + 1 + random.below(12)).min(datagrams.len())].to_vec()
        } else {
            // From the beginning, without which there is no connection, then on from anywhere.
            let mut bytes = file[..(1 + random.below(3000)).min(file.len())].to_vec();
            let from = random.below(file.len());
            bytes.extend(&file[from..(from + random.below(500)).min(file.len())]);
            (0..random.below(6)).for_each(|_| change(&mut bytes, &mut random));
            bytes.chunks(1 + random.below(600)).map(<[u8]>::to_vec).collect()
        };
        if is_datagrams {
            for _ in 0..random.below(6) {
                let which = random.below(pieces.len());
                change(&mut pieces[which], &mut random);
            }
        }
        let began = Instant::now();
        let mut stream = ViconStream::new(&settings);
        let counters = ViconCounters::default();
        stream.beat();
        for (now, piece) in (1_i64..).zip(&pieces) {
            pieces_count += 1;
            stream.set_airborne(now % 8 >= 4);
            let seen = |sighting: tello_io::vicon::Sighting| {
                sightings += 1;
                assert!(sighting.pose.is_none_or(|pose| pose.iter().all(|row| row.is_finite())), "{sighting:?}");
            };
            if stream.push(piece, TimeNs(now * 10_000_000), &counters, seen).is_err() {
                given_up += 1;
                stream.restart();
            }
            stream.beat();
            let mut requests = Vec::new();
            stream.take_requests(&mut requests);
            assert!(requests.len() < 4096, "{} bytes are asked", requests.len());
        }
        slowest = slowest.max(began.elapsed());
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    println!("{}: {runs} runs, {pieces_count} pieces, {sightings} sightings, {given_up} given up, slowest run {slowest:?}, {peak}", arguments[1]);
}
