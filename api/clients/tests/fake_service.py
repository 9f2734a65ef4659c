"""An HTTP server that answers from a list: for what a client makes of refusals, losses and answers cut short."""

import http.server
import threading


class FakeService:
    """Answers are (status, headers, body), or None for a connection that is dropped; `requests` are (client's address, path,
    headers, body)."""

    def __init__(self, *answers):
        self.answers, self.requests = list(answers), []
        fake, lock = self, threading.Lock()

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self):
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                with lock:
                    fake.requests.append((self.client_address, self.path, dict(self.headers), body))
                    answer = fake.answers.pop(0) if fake.answers else (500, {}, b"no more")
                if answer is None:
                    self.close_connection = True
                    return
                status, headers, content = answer
                if "Server" in headers:  # in place of this server's own name
                    self.send_response_only(status)
                else:
                    self.send_response(status)
                for name, value in {"Content-Length": str(len(content)), **headers}.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(content)
                self.close_connection = "close after" in headers.values()

            do_GET = do_POST

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.01,))

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()
