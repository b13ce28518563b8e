use super::*;

fn block_on<T>(task: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(task)
}

/// A connector to a host with `addresses`, whose name is looked up by `lookup`.
fn connector(
    addresses: &[SocketAddr],
    lookup: impl Future<Output = io::Result<Vec<SocketAddr>>> + Send + 'static,
) -> Connector {
    let (transport, addresses) = (Transport::Tcp("server:1".into()), addresses.to_vec());
    Connector { transport, addresses, lookup: Some(tokio::spawn(lookup)) }
}

/// A listener, and its address.
fn listener() -> (std::net::TcpListener, SocketAddr) {
    let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

#[test]
fn a_name_that_resolves_late_is_connected_to_and_is_named_until_then() {
    let (_listener, address) = listener();
    block_on(async {
        let mut connector = connector(&[], async move {
            tokio::time::sleep(NAME_TIMEOUT + Duration::from_millis(300)).await;
            Ok(vec![address])
        });
        let error = connector.open().await.unwrap_err();
        assert_eq!(error.to_string(), "its name is not resolved so far");
        assert!(matches!(connector.open().await.unwrap(), Wire::Tcp(_)));
    });
}

#[test]
fn a_name_that_does_not_resolve_any_more_has_the_addresses_of_before() {
    let (_listener, address) = listener();
    block_on(async {
        let mut silent = connector(&[address], std::future::pending());
        assert!(silent.open().await.is_ok() && silent.lookup.is_some());
        let gone = async { Err(io::ErrorKind::NotFound.into()) };
        assert!(connector(&[address], gone).open().await.is_ok());
        let gone = async { Err(io::ErrorKind::NotFound.into()) };
        let error = connector(&[], gone).open().await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
    });
}

#[test]
fn an_address_that_is_silent_costs_its_time_once_and_not_the_others() {
    // Its queue is full: the kernel drops what would begin another connection.
    let full = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    full.bind(&SocketAddr::from((Ipv4Addr::LOCALHOST, 0)).into()).unwrap();
    full.listen(0).unwrap();
    let silent = full.local_addr().unwrap().as_socket().unwrap();
    let _fills = std::net::TcpStream::connect(silent).unwrap();
    let (_listener, good) = listener();
    block_on(async {
        let mut connector = connector(&[], async move { Ok(vec![silent, good]) });
        assert!(connector.open().await.is_ok());
        assert_eq!(connector.addresses, [good, silent]);
        connector.lookup = Some(tokio::spawn(async move { Ok(vec![silent, good]) }));
        timeout(CONNECT_TIMEOUT / 2, connector.open()).await.unwrap().unwrap();
        connector.lookup = Some(tokio::spawn(async move { Ok(vec![silent]) }));
        let error = connector.open().await.unwrap_err();
        assert_eq!(error.to_string(), NO_ANSWER);
    });
}

#[test]
fn a_socket_that_was_ready_for_nothing_has_no_bytes_and_other_errors_stay() {
    let (count, from) = would_block(io::ErrorKind::WouldBlock.into()).unwrap();
    assert_eq!((count, from.ip()), (0, IpAddr::V4(Ipv4Addr::UNSPECIFIED)));
    let refused = would_block(io::ErrorKind::ConnectionReset.into()).unwrap_err();
    assert_eq!(refused.kind(), io::ErrorKind::ConnectionReset);
}

#[test]
fn the_end_of_a_connection_is_an_error_and_no_piece_of_no_bytes() {
    let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let error = block_on(async {
        let mut wire = Wire::Tcp(TcpStream::connect(address).await.unwrap());
        drop(listener.accept().unwrap());
        wire.read(&mut [0; 8]).await.unwrap_err()
    });
    assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
}

#[test]
fn natnet_over_ipv6_is_refused_by_name() {
    let addresses = ["[::1]:1510".parse().unwrap()];
    let error = block_on(NatnetWire::open("motive:1510", &addresses)).unwrap_err();
    assert!(error.to_string().contains("IPv4 only"), "{error}");
}

#[test]
fn natnet_is_tried_at_each_ipv4_address_in_turn_while_no_message_comes() {
    let found = ["[::1]:1510", "192.0.2.1:1510", "192.0.2.2:1510", "192.0.2.3:1510"]
        .map(|address| address.parse().unwrap());
    block_on(async {
        let mut connector = connector(&[], async move { Ok(found.into()) });
        connector.transport = Transport::Natnet("motive:1510".into());
        for expected in [1, 2, 3, 1] {
            for _ in 0..2 {
                // A connection that brought messages is made anew to the same address.
                let Wire::Natnet(wire) = connector.open().await.unwrap() else { panic!() };
                assert_eq!(wire.server, found[expected]);
                connector.lookup = Some(tokio::spawn(async move { Ok(found.into()) }));
            }
            connector.note_silence();
        }
    });
}

#[test]
fn a_tcp_connection_without_a_message_does_not_change_the_address() {
    let addresses = ["192.0.2.1:801", "192.0.2.2:801"].map(|address| address.parse().unwrap());
    block_on(async {
        let mut connector = connector(&addresses, std::future::pending());
        connector.note_silence();
        assert_eq!(connector.addresses, addresses);
    });
}

#[test]
fn datagrams_of_another_system_are_left_out() {
    let server = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let other = std::net::UdpSocket::bind("127.0.0.2:0").unwrap();
    let address = server.local_addr().unwrap();
    block_on(async {
        let mut wire = NatnetWire::open("motive:1510", &[address]).await.unwrap();
        let to = (Ipv4Addr::LOCALHOST, wire.command.local_addr().unwrap().port());
        other.send_to(b"other", to).unwrap();
        server.send_to(b"ours", to).unwrap();
        let mut chunk = [0; 16];
        let count = wire.read(&mut chunk).await.unwrap();
        assert_eq!(&chunk[..count], b"ours");
    });
}
