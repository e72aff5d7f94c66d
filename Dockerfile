# gtlayout in a container:
#   docker build --tag gtlayout .
#   docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD/examples/room:/scene" gtlayout
# solves the folder that is mounted at /scene; any other command follows the name: … gtlayout report /scene
# Other extras than these: docker build --build-arg EXTRAS=batch,colmap,view …
FROM python:3.13-slim
ARG EXTRAS=colmap,report
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY factors factors
COPY gtlayout gtlayout
RUN pip install --no-cache-dir --constraint constraints.txt ".[$EXTRAS]" && rm -rf build *.egg-info
# Away from the sources: what is installed is what runs.
WORKDIR /scene
ENTRYPOINT ["gtlayout"]
CMD ["solve", "/scene"]
