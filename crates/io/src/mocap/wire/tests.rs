use std::net::UdpSocket as Server;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};

use super::super::natnet::encode;
use super::*;

fn runtime() -> Runtime {
    Builder::new_current_thread().enable_all().build().unwrap()
}

fn server() -> Server {
    let server = Server::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    // Longer than any datagram takes on one machine.
    server.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    server
}

fn received(server: &Server) -> (Vec<u8>, SocketAddr) {
    let mut chunk = [0; 2048];
    let (count, from) = server.recv_from(&mut chunk).unwrap();
    (chunk[..count].to_vec(), from)
}

#[test]
fn each_question_to_a_natnet_server_is_a_datagram() {
    let server = server();
    runtime().block_on(async {
        let mut wire = NatnetWire::open(&server.local_addr().unwrap().to_string()).await.unwrap();
        let mut questions = Vec::new();
        encode::request(1, b"one", &mut questions);
        let first = questions.len();
        encode::request(2, b"second", &mut questions);
        // A beginning that is no datagram is not sent.
        let whole = questions.len();
        questions.push(0);
        wire.write(&questions).await.unwrap();
        assert_eq!(received(&server).0, questions[..first]);
        assert_eq!(received(&server).0, questions[first..whole]);
        wire.write(&[0]).await.unwrap();
        wire.write(&questions[..first]).await.unwrap();
        assert_eq!(received(&server).0, questions[..first]);
    });
}

#[test]
fn datagrams_of_another_machine_are_not_those_of_the_server() {
    let (server, other_port) = (server(), server());
    let stranger = Server::bind((Ipv4Addr::new(127, 0, 0, 2), 0)).unwrap();
    runtime().block_on(async {
        let mut wire = NatnetWire::open(&server.local_addr().unwrap().to_string()).await.unwrap();
        let mut question = Vec::new();
        encode::request(1, b"", &mut question);
        wire.write(&question).await.unwrap();
        let (_, client) = received(&server);
        let client = (Ipv4Addr::LOCALHOST, client.port());
        for (socket, text) in [(&stranger, "stranger"), (&other_port, "port"), (&server, "server")]
        {
            socket.send_to(text.as_bytes(), client).unwrap();
        }
        let mut chunk = [0; 100];
        for expected in ["port", "server"] {
            let count = wire.read(&mut chunk).await.unwrap();
            assert_eq!(chunk[..count], *expected.as_bytes());
        }
    });
}

#[test]
fn a_connection_that_is_closed_is_an_error_and_no_empty_piece() {
    runtime().block_on(async {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        let (mut server, _) = listener.accept().await.unwrap();
        let mut wire = Wire::Tcp(client);
        server.write_all(b"last").await.unwrap();
        drop(server);
        let mut chunk = [0; 100];
        assert_eq!(wire.read(&mut chunk).await.unwrap(), 4);
        let error = wire.read(&mut chunk).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    });
}

#[test]
fn the_object_stream_is_never_answered_and_only_natnet_joins_a_group() {
    runtime().block_on(async {
        let mut wire = Wire::Udp(UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap());
        // Without a peer, a socket that sends has an error.
        wire.write(b"anything").await.unwrap();
        wire.join("239.255.42.99:1511".parse().ok()).unwrap();
        assert!(matches!(wire, Wire::Udp(_)));
    });
}

#[test]
fn only_the_lack_of_a_datagram_is_no_error() {
    let (count, from) = would_block(io::ErrorKind::WouldBlock.into()).unwrap();
    assert!(count == 0 && from.ip().is_unspecified());
    for kind in [io::ErrorKind::ConnectionReset, io::ErrorKind::Interrupted] {
        assert_eq!(would_block(kind.into()).unwrap_err().kind(), kind);
    }
}
