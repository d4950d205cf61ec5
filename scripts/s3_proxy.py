"""HTTP proxy in front of a store on this machine that injects faults; used by check_s3.py."""
import http.client
import http.server
import socket
import ssl
import struct
import threading
import time

FORBIDDEN = """<?xml version="1.0" encoding="UTF-8"?>
<Error><Code>SignatureDoesNotMatch</Code><Message>The request signature we calculated does not match.</Message>\
<AWSAccessKeyId>{key}</AWSAccessKeyId><StringToSign>AWS4-HMAC-SHA256 {key} secret-string-to-sign</StringToSign></Error>"""
SLOW_DOWN = "<Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>"


class Proxy:
    """Forwards to `upstream` (host, port). `rule(n, method, path)` returns the fault of the n-th request, or None:
    an HTTP status (403, 429, 500, 503), a delay in seconds (float), "reset" (connection reset inside the request body), "lost" (request
    executed, connection reset before the response) or "cut" (connection reset inside the response body)."""

    def __init__(self, upstream, rule=None, certificate=None):
        self.upstream, self.rule = upstream, rule or (lambda n, method, path: None)
        self.lock = threading.Lock()
        self.requests = self.faults = self.puts = self.max_puts = 0
        proxy = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_):
                pass

            def do_GET(self):
                proxy.handle(self)

            do_PUT = do_POST = do_HEAD = do_DELETE = do_GET

        class Server(http.server.ThreadingHTTPServer):
            daemon_threads = True
            request_queue_size = 64

            def handle_error(self, *_):
                pass  # connections reset on purpose

        self.server = Server(("127.0.0.1", 0), Handler)
        if certificate:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*certificate)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()

    def handle(self, to):
        with self.lock:
            self.requests += 1
            n = self.requests
        put = to.command == "PUT"
        if put:
            with self.lock:
                self.puts += 1
                self.max_puts = max(self.max_puts, self.puts)
        try:
            fault = self.rule(n, to.command, to.path)
            if fault:
                with self.lock:
                    self.faults += 1
            self.respond(to, fault)
        finally:
            if put:
                with self.lock:
                    self.puts -= 1

    def respond(self, to, fault):
        length = int(to.headers.get("Content-Length") or 0)
        if fault == "reset":  # after half of the request body
            to.rfile.read(length // 2)
            return self.reset(to)
        body = to.rfile.read(length)
        if isinstance(fault, float):
            time.sleep(fault)
        if fault in (503, 429, 500):
            return self.send(to, fault, SLOW_DOWN)
        if fault == 403:
            return self.send(to, 403, FORBIDDEN.format(key="AKIAHUSHHUSH"))
        c = http.client.HTTPConnection(*self.upstream, timeout=60)
        headers = {k: v for k, v in to.headers.items() if k.lower() not in ("connection", "content-length")}
        c.request(to.command, to.path, body if length or to.command == "PUT" else None, headers)
        r = c.getresponse()
        data = r.read()
        if fault == "lost":  # executed, but no response
            return self.reset(to)
        to.send_response(r.status)
        for k, v in r.getheaders():
            if k.lower() not in ("connection", "transfer-encoding", "content-length", "server", "date"):
                to.send_header(k, v)
        to.send_header("Content-Length", r.getheader("Content-Length") if to.command == "HEAD" else str(len(data)))
        to.end_headers()
        if to.command == "HEAD":
            return
        if fault == "cut" and len(data) > 1:
            to.wfile.write(data[: len(data) // 2])
            to.wfile.flush()
            return self.reset(to)
        to.wfile.write(data)

    def send(self, to, status, text):
        data = b"" if to.command == "HEAD" else text.encode()
        to.send_response(status)
        to.send_header("Content-Type", "application/xml")
        to.send_header("Content-Length", str(len(data)))
        to.end_headers()
        to.wfile.write(data)

    @staticmethod
    def reset(to):
        to.close_connection = True
        to.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        to.connection.close()
