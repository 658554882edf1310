# docker build -t pumaid . && docker run --rm -v "$PWD:/data" pumaid identify logs/
FROM python:3.12-slim
COPY pyproject.toml README.md LICENSE /src/
COPY pumaid /src/pumaid
COPY recipes /src/recipes
RUN pip install --no-cache-dir '/src[ros]' && rm -r /src
WORKDIR /data
ENTRYPOINT ["pumaid"]
CMD ["--help"]
